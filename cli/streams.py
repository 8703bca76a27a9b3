"""What reaches the terminal: photogram's own words, in whatever characters the terminal has."""

from __future__ import annotations

import io
import logging
import sys


def prepare_streams() -> None:
    """Keep the libraries' warnings off the terminal, and let no character stop the output.

    Warnings and messages of Pillow, NumPy, PROJ, GDAL and others go to the root logger, which shows them to nobody
    unless a program that uses photogram asks for them. What the terminal's encoding does not have is written out.
    """
    logging.captureWarnings(True)
    # otherwise logging prints the warnings of libraries that no handler takes
    logging.getLogger().addHandler(logging.NullHandler())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
