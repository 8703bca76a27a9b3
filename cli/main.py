"""The command `photogram`: runs the application and turns what it raises into messages and exit codes."""

from __future__ import annotations

import io
import logging
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from photogram.cli import adjust, check, compare, demo, init, plan, report, study, view  # noqa: F401 - they register
from photogram.cli.app import CommandError, app
from photogram.cli.outcomes import output_fault, say_outcome, say_output_fault


def main() -> None:
    """Run the command line and end with its exit code (``outcomes``)."""
    with _nothing_raw() as unwatched:
        sys.exit(_finished(_run(), unwatched))


@contextmanager
def _nothing_raw() -> Iterator[list[BaseException]]:
    """Let nothing reach the terminal raw: names that it cannot show stand as escapes, warnings of libraries go to the
    log (which -v shows), and what a thread raises that nobody waits for is collected in the list given."""
    unwatched: list[BaseException] = []
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    log, silent, usual = logging.getLogger(), logging.NullHandler(), threading.excepthook
    log.addHandler(silent)  # without any handler Python prints warnings
    logging.captureWarnings(True)
    threading.excepthook = lambda raised: unwatched.append(raised.exc_value or raised.exc_type())
    try:
        yield unwatched
    finally:
        threading.excepthook = usual
        logging.captureWarnings(False)
        log.removeHandler(silent)


def _run() -> int:
    try:
        app(prog_name="photogram")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except CommandError as error:
        return say_outcome(error.cause, error.command, error.verbosity)
    except (Exception, KeyboardInterrupt) as cause:  # noqa: BLE001 - the one place that answers everything that is left
        return say_outcome(cause, None, 0)
    return 0


def _finished(code: int, unwatched: list[BaseException]) -> int:
    """Return the exit code after all output is written and what threads raised is said."""
    if code == 0 and unwatched:
        code = say_outcome(unwatched[0], None, 0)
    fault = output_fault()
    return code if fault is None else say_output_fault(fault)


if __name__ == "__main__":
    main()
