"""`photogram mark` as a process of its own, and the requests that its page makes."""

import http.client
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

PATIENCE_S = 600.0
_ADDRESS = re.compile(r"http://127\.0\.0\.1:(\d+)/([\w-]+)/")
Answer = dict[str, object]


class Page:
    """One connection to the server, as a tab has it; one thread may use it."""

    def __init__(self, port: int, token: str) -> None:
        self._token = token
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)

    def get(self, address: str) -> bytes:
        """Return what the server answers. Raises OSError or HTTPException where it does not, SystemExit where it
        refuses."""
        self._connection.request("GET", f"/{self._token}/{address}")
        return self._answer(address)

    def record(self, address: str) -> Answer:
        """Return the object that the server answers; raises as ``get``."""
        return _object(self.get(address))

    def point(self, name: str) -> Answer:
        """Return a point and its photographs; raises as ``get``."""
        return self.record(f"point/{quote(name, safe='')}")

    def act(self, action: Mapping[str, object]) -> Answer:
        """Have something done, and return the answer; raises as ``get``."""
        self._connection.request(
            "POST", f"/{self._token}/action", json.dumps(action), {"Content-Type": "application/json"}
        )
        return _object(self._answer(str(action)))

    def _answer(self, what: str) -> bytes:
        response = self._connection.getresponse()
        content = response.read()
        if response.status != http.client.OK:
            raise SystemExit(f"{what}: {response.status} {content.decode(errors='replace')[:200]}")
        return content

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


def _object(content: bytes) -> Answer:
    value = json.loads(content)
    if not isinstance(value, dict):
        raise SystemExit(f"no object: {content[:200]!r}")
    return value


@dataclass
class MarkCommand:
    """The running command; what it says goes to ``log``."""

    process: subprocess.Popen[bytes]
    log: Path
    began_s: float

    @property
    def said(self) -> str:
        """What it has said so far, on one line each."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    def address(self) -> tuple[int, str, float]:
        """Wait for the address of the page; return its port, its token, and how many seconds it took. Raises SystemExit
        with what the command says where it ends before."""
        while time.monotonic() < self.began_s + PATIENCE_S:
            found = _ADDRESS.search(self.said)
            if found:
                return int(found[1]), found[2], time.monotonic() - self.began_s
            if self.process.poll() is not None:
                break
            time.sleep(0.005)
        raise SystemExit(f"photogram mark gives no address:\n{self.said}")

    def kill(self) -> None:
        """End it as nothing that is caught can."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    @property
    def peak_bytes(self) -> int:
        """The most memory that it has had (VmHWM)."""
        return _memory_bytes(self.process.pid, "VmHWM")

    @property
    def present_bytes(self) -> int:
        """The memory that it has now (VmRSS)."""
        return _memory_bytes(self.process.pid, "VmRSS")


def _memory_bytes(process: int, name: str) -> int:
    for line in Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines():
        if line.startswith(f"{name}:"):
            return 1024 * int(line.split()[1])
    raise SystemExit(f"/proc does not tell {name}")


def photogram() -> Path:
    """Return the command of this environment."""
    return Path(sys.executable).with_name("photogram")


def started(project: Path, log: Path) -> MarkCommand:
    """Start `photogram mark` for a project."""
    with log.open("wb") as stream:
        began_s = time.monotonic()
        process = subprocess.Popen(
            [photogram(), "mark", project, "--no-browser"],
            stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT,
        )  # fmt: skip
    return MarkCommand(process, log, began_s)


@contextmanager
def running(project: Path, log: Path) -> Iterator[MarkCommand]:
    """Run `photogram mark` while the block runs."""
    command = started(project, log)
    try:
        yield command
    finally:
        command.kill()
