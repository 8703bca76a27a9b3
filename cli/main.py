"""The command `photogram`: runs the application and turns what it raises into messages and exit codes."""

from __future__ import annotations

import sys

from photogram.cli.app import CommandError, app
from photogram.cli.commands import (
    adjust,  # noqa: F401 - they register
    audit,  # noqa: F401 - they register
    calibrate_site,  # noqa: F401 - they register
    check,  # noqa: F401 - they register
    compare,  # noqa: F401 - they register
    demo,  # noqa: F401 - they register
    export,  # noqa: F401 - they register
    import_solution,  # noqa: F401 - they register
    init,  # noqa: F401 - they register
    mark,  # noqa: F401 - they register
    plan,  # noqa: F401 - they register
    report,  # noqa: F401 - they register
    schema,  # noqa: F401 - they register
    study,  # noqa: F401 - they register
    view,  # noqa: F401 - they register
)
from photogram.cli.interruption import interruptible
from photogram.cli.outcomes import output_fault, say_outcome, say_output_fault
from photogram.cli.streams import nothing_raw


def main() -> None:
    """Run the command line and end with its exit code (``outcomes``)."""
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
    fault = output_fault()
    return code if fault is None else say_output_fault(fault)


if __name__ == "__main__":
    main()
