"""The command `photogram`: runs the application and turns what it raises into messages and exit codes."""

import sys

from photogram.cli.app import CommandError, app
from photogram.cli.streams import nothing_raw
from photogram.terminal.exit_codes import output_error, say_outcome, say_output_error
from photogram.terminal.interruption import interruptible


def main() -> None:
    """Run the command line and end with its exit code (``exit_codes``)."""
    with nothing_raw() as unwatched, interruptible():
        sys.exit(_finished(_run(), unwatched))


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
    error = output_error()
    return code if error is None else say_output_error(error)


if __name__ == "__main__":
    main()
