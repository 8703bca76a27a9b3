"""What reaches the terminal: photogram's own words, in whatever characters the terminal has."""

from __future__ import annotations

import io
import logging
import os
import sys


def prepare_streams() -> None:
    """Keep the libraries' warnings off the terminal, and let no character stop the output.

    Warnings and messages of Pillow, NumPy, PROJ, GDAL and others go to the root logger, which shows them to nobody
    unless a program that uses photogram asks for them; what libraries in C write past Python is dropped, unless -vv
    is asked for. What the terminal's encoding does not have is written out.
    """
    logging.captureWarnings(True)
    # otherwise logging prints the warnings of libraries that no handler takes
    logging.getLogger().addHandler(logging.NullHandler())
    if "-vv" not in sys.argv:
        _keep_standard_error()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _keep_standard_error() -> None:
    """Keep the process's standard error to Python: libtiff, for one, writes to it past every handler."""
    try:
        if sys.stderr.fileno() != 2:
            return  # a test, or a program that has its own
    except (AttributeError, OSError, ValueError):
        return  # there is none
    own = os.dup(2)
    sys.stderr = io.TextIOWrapper(
        os.fdopen(own, "wb"), encoding=sys.stderr.encoding, errors="backslashreplace", line_buffering=True
    )
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
