"""A processing node for tests: asked without a network, or served to PyODM as WebODM would ask it."""

import asyncio
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import urlencode

import yaml
from pyodm import Node as Client
from pyodm.api import Task
from pyodm.types import TaskInfo, TaskStatus
from starlette.applications import Starlette
from starlette.types import ASGIApp, Message

from photogram.node.addresses import Addresses
from photogram.node.node import Node, NodeSettings
from photogram.node.server import NodeServer

FOCAL = {"focal-px": 604, "min-num-features": 800}
"""Options that the rendered photographs need, whose tags give no focal length, and that small ones suffice with."""

PATIENCE_S = 300.0
FULL = Path("/dev/full")
"""A device on Linux that takes nothing."""
BOUNDARY = "a-boundary-of-parts"


@dataclass(frozen=True)
class Reply:
    """What was answered."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def error(self) -> str:
        assert self.status == 200, self.body
        return str(self.json["error"])


def multipart(fields: Mapping[str, str], files: Sequence[tuple[str, bytes]] = ()) -> bytes:
    """Return the body of a form; files are names and contents."""
    parts = [f'Content-Disposition: form-data; name="{name}"\r\n\r\n{value}'.encode() for name, value in fields.items()]
    for name, content in files:
        head = f'Content-Disposition: form-data; name="images"; filename="{name}"\r\nContent-Type: image/jpeg\r\n\r\n'
        parts.append(head.encode() + content)
    return b"".join(f"--{BOUNDARY}\r\n".encode() + part + b"\r\n" for part in parts) + f"--{BOUNDARY}--\r\n".encode()


def asked(
    app: ASGIApp,
    method: str,
    address: str,
    body: bytes | Sequence[bytes] = b"",
    headers: Mapping[str, str] | None = None,
    query: Mapping[str, str] | None = None,
) -> Reply:
    """Ask an application without a network. A body in pieces ends with the connection where its last piece is None."""
    pieces = [body] if isinstance(body, bytes) else list(body)
    messages: list[Message] = [
        {"type": "http.disconnect"} if piece is None else
        {"type": "http.request", "body": piece, "more_body": number < len(pieces) - 1}
        for number, piece in enumerate(pieces)
    ]  # fmt: skip
    given = {"content-type": f"multipart/form-data; boundary={BOUNDARY}", "host": "127.0.0.1:3000", **(headers or {})}
    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method, "scheme": "http",
        "path": address, "raw_path": address.encode(), "root_path": "", "query_string": urlencode(query or {}).encode(),
        "headers": [(name.encode(), value.encode()) for name, value in given.items()],
        "server": ("127.0.0.1", 3000), "client": ("127.0.0.1", 5000),
    }  # fmt: skip
    sent: list[Message] = []

    async def receive() -> Message:
        return messages.pop(0) if messages else {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        sent.append(message)

    async def answered() -> None:
        await app(scope, receive, send)

    asyncio.run(answered())
    head = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
    return Reply(sent[0]["status"], head, b"".join(message.get("body", b"") for message in sent[1:]))


def application(node: Node, token: str = "") -> Starlette:
    """Return the addresses of a node as an application."""
    return Starlette(routes=Addresses(node, token).routes())


@contextmanager
def served(folder: Path, token: str = "", **settings: Any) -> Iterator[Client]:
    """Serve a node in a thread, and give PyODM's client of it."""
    with Node(NodeSettings(folder, **settings)) as node:
        server = NodeServer(node, "127.0.0.1", 0, token)
        thread = Thread(target=server.serve)
        thread.start()
        try:
            yield Client("127.0.0.1", server.port, token)
        finally:
            server.stop()
            thread.join()


def waited(task: Task, wanted: Callable[[TaskInfo], bool]) -> TaskInfo:
    """Return what a task does once it is as wanted."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        info = task.info()
        if wanted(info):
            return info
        time.sleep(0.2)
    raise AssertionError(f"still {task.info()}: {task.output()}")


def ended(info: TaskInfo) -> bool:
    """Return whether a task has ended."""
    return info.status in (TaskStatus.COMPLETED, TaskStatus.FAILED, TaskStatus.CANCELED)


def ground_points(project: Path, folder: Path) -> list[Path]:
    """Write the ground points of a rendered survey as OpenDroneMap has them: control points and check points."""
    survey = yaml.safe_load(project.read_text(encoding="utf-8"))
    files = {"control": folder / "gcp_list.txt", "check": folder / "check_list.txt"}
    for role, file in files.items():
        lines = [survey["crs"]]
        for point in survey["control_points"]["list"]:
            place = " ".join(map(str, point["position_m"]))
            if point["role"] == role:
                lines += [f"{place} {u} {v} {name} {point['name']}" for name, (u, v) in point["marks"].items()]
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return list(files.values())
