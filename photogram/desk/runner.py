"""The process of a run: starts the command as a terminal would and leaves its exit code in a file, however it ends.

`python -m photogram.desk.runner FILE ARGUMENTS…`; interruptions are left to the command, which ends in order.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path

from photogram.files.atomic import replacing


def main() -> None:
    """Run the command of the arguments."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    code = subprocess.call(
        [sys.executable, "-m", "photogram.cli.main", *sys.argv[2:]],
        stdin=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    with replacing(Path(sys.argv[1])) as path:
        path.write_text(json.dumps({"exit_code": code}))


if __name__ == "__main__":
    main()
