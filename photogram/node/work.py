"""What `photogram serve` does."""

import signal
from pathlib import Path
from types import FrameType

from rich.markup import escape

from photogram.errors import WorkspaceError
from photogram.node.node import Node, NodeSettings
from photogram.node.server import NodeServer, is_loopback
from photogram.terminal.console import console

_GB = 1_000_000_000


def run(
    folder: Path,
    host: str,
    port: int,
    token: str,
    parallel_tasks: int,
    max_images: int | None,
    max_task_gb: float | None,
    keep_days: float | None,
) -> None:
    """Serve a node until Ctrl-C, or until it is told to end (SIGTERM)."""
    most = None if max_task_gb is None else round(_GB * max_task_gb)
    with Node(NodeSettings(folder.absolute(), parallel_tasks, max_images, most, keep_days)) as node:
        try:
            server = NodeServer(node, host, port, token)
        except (OSError, UnicodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise WorkspaceError(
                f"port {port} of {host} cannot be used ({reason}): give others with --host and --port"
            ) from error
        console.print(f"Node: {server.url}", soft_wrap=True, highlight=False)
        console.print(f"Tasks: {escape(str(folder.absolute()))}", soft_wrap=True, highlight=False)
        for sentence in openness(host, token):
            console.print(sentence, soft_wrap=True)
        console.print("In WebODM: Processing Nodes, Add New, with this host and port. Ctrl-C ends; tasks go on.")
        signal.signal(signal.SIGTERM, lambda number, frame: _end(server, number, frame))
        server.serve()
    console.print("Ended.")


def _end(server: NodeServer, _number: int, _frame: FrameType | None) -> None:
    server.stop()


def openness(host: str, token: str) -> list[str]:
    """Return who reaches a node, in sentences."""
    if is_loopback(host):
        return ["Only this machine reaches it; --host 0.0.0.0 opens it to others."]
    if not token:
        return [
            "[yellow]warning[/yellow] this node has no token: it takes tasks from anyone who reaches this address, and "
            "hands their results to anyone; set one with --token"
        ]
    return ["Token and photographs are sent unencrypted: beyond a network that you trust, put HTTPS before it."]
