"""photogram serve: a processing node. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer

PORT = 3000
"""NodeODM's."""


def serve(
    nodeodm: Annotated[
        bool, typer.Option("--nodeodm", help="Speak NodeODM's interface, for WebODM and PyODM; needed.")
    ] = False,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address to listen on; 0.0.0.0: all of this machine.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, metavar="N", help="Port; 0 picks a free port.")] = PORT,
    token: Annotated[
        str,
        typer.Option(
            metavar="TEXT",
            envvar="PHOTOGRAM_NODE_TOKEN",
            help="Token that every request must name.",
            show_default=False,
            show_envvar=True,
        ),
    ] = "",
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the tasks.")] = Path("photogram-node"),
    parallel_tasks: Annotated[int, typer.Option(metavar="N", min=1, help="Tasks that are worked on at a time.")] = 1,
    max_images: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Photographs that a task may have.", show_default=False)
    ] = None,
    max_task_gb: Annotated[
        float | None,
        typer.Option("--max-task-gb", metavar="GB", min=0.001, help="Upload of a task, GB.", show_default=False),
    ] = None,
    keep_days: Annotated[
        float | None,
        typer.Option(
            metavar="DAYS",
            min=0.1,
            help="Delete tasks so many days after their end, and uploads that nobody completes; default: never.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Serve this machine as a processing node: WebODM and PyODM send it photographs, and get maps back.

    A task goes on when this command ends, and is watched again when it starts. Ctrl-C ends.
    """
    if not nodeodm:
        raise typer.BadParameter("name the interface to speak: --nodeodm", param_hint="'--nodeodm'")
    from photogram.node import work

    work.run(folder, host, port, token, parallel_tasks, max_images, max_task_gb, keep_days)
