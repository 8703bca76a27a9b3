"""The process of a run: starts a module as a terminal would and leaves its exit code in a file, however it ends.

`python -m photogram.background.runner LOCK FILE MODULE ARGUMENTS…`. It holds a lock as long as it lives, which tells
others that the run does; where somebody else has it nothing is started. Interruptions are left to the module, which
ends in order.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from photogram.files.atomic import replacing
from photogram.files.portable import try_lock

IS_TAKEN = 75
"""Exit code where another run has the lock."""
PATIENCE_S = 10.0


def main() -> None:
    """Run the module of the arguments."""
    # a handler, and not SIG_IGN, which the command would inherit
    signal.signal(signal.SIGINT, lambda *_: None)
    with Path(sys.argv[1]).open("ab") as lock:
        end = time.monotonic() + PATIENCE_S  # others look at it, and then for a moment it is theirs
        while not try_lock(lock.fileno()):
            if time.monotonic() > end:
                sys.exit(IS_TAKEN)
            time.sleep(0.02)
        code = subprocess.call([sys.executable, "-m", *sys.argv[3:]], stdin=subprocess.DEVNULL)
        with replacing(Path(sys.argv[2])) as path:
            path.write_text(json.dumps({"exit_code": code}))


if __name__ == "__main__":
    main()
