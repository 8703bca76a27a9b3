"""The command `photogram`: runs the application and turns faults into messages and exit codes."""

from __future__ import annotations

import sys

from photogram.cli.app import app
from photogram.cli.streams import prepare_streams
from photogram.errors import PhotogramError
from photogram.printable import printable


def main() -> None:
    """Run the command line; exit code 0 done, 1 the survey failed, 2 wrong usage, 130 interrupted."""
    prepare_streams()
    # The commands register themselves and take seconds to import, which `photogram --version` need not wait for.
    if sys.argv[1:] != ["--version"]:
        from photogram.cli import adjust, check, compare, demo, init, plan, report, study, view  # noqa: F401

    try:
        app(prog_name="photogram")
    except PhotogramError as fault:
        if "-vv" in sys.argv:
            raise
        sys.stderr.write(f"photogram: {printable(str(fault))}\n")
        sys.exit(1)
    except KeyboardInterrupt:
        sys.stderr.write("photogram: interrupted; what is finished is kept, the next run goes on from there\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
