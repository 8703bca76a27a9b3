"""What `photogram desk` does."""

import webbrowser
from pathlib import Path

from rich.markup import escape

from photogram.desk.desk import Desk
from photogram.desk.server import DeskServer
from photogram.errors import WorkspaceError
from photogram.loopback.server import ADDRESS
from photogram.terminal.console import console


def run(folder: Path | None, browser: bool, port: int, tiles: str | None = None) -> None:
    """Serve the page until Ctrl-C."""
    with Desk(tiles=tiles) as desk:
        if folder is not None:
            desk.open(folder)
        try:
            server = DeskServer(desk, port)
        except OSError as error:
            raise WorkspaceError(
                f"port {port} of {ADDRESS} cannot be used ({error.strerror}): give another with --port, or none"
            ) from error
        console.print(f"Desk: {server.url}", soft_wrap=True)
        console.print("For this machine and this session alone. Ctrl-C ends; a run that was started goes on.")
        if folder is not None:
            console.print(f"Survey: {escape(str(folder))}", soft_wrap=True)
        if browser and not webbrowser.open(server.url):
            console.print("No browser found: open this address yourself.")
        server.serve()
    console.print("Ended.")
