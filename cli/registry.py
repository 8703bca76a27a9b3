"""The commands, in the order of the help: the one table in which they register.

A wing brings its commands with it: where a wing is not installed, its commands are not there, and all others are.
"""

from importlib import import_module
from importlib.util import find_spec

import typer

COMMANDS = {
    "desk": "photogram.desk.command:desk",
    "demo": "photogram.simulation.commands.demo:demo",
    "plan": "photogram.simulation.commands.plan:plan",
    "calibrate-site": "photogram.local_grids.command:calibrate_site",
    "init": "photogram.cli.commands.init:init",
    "import": "photogram.exchange.commands.import_solution:import_solution",
    "mark": "photogram.marking.command:mark",
    "check": "photogram.cli.commands.check:check",
    "adjust": "photogram.cli.commands.adjust:adjust",
    "report": "photogram.cli.commands.report:report",
    "view": "photogram.cli.commands.view:view",
    "export": "photogram.exchange.commands.export:export",
    "deliver": "photogram.delivery.command:deliver",
    "compare": "photogram.change.commands.compare:compare",
    "epochs": "photogram.change.commands.epochs:epochs",
    "volume": "photogram.change.commands.volume:volume",
    "audit": "photogram.exchange.commands.audit:audit",
    "verify": "photogram.verification.command:verify",
    "donate": "photogram.donation.command:donate",
    "study": "photogram.teaching.command:experiments",
    "serve": "photogram.node.command:serve",
    "schema": "photogram.cli.commands.schema:schema",
}
"""Name of each command, and the function that has its arguments, or the group of its commands."""


def register_commands(app: typer.Typer) -> None:
    """Add the commands of all wings that are installed to an application."""
    for name, place in COMMANDS.items():
        module, definition = place.split(":")
        if find_spec(".".join(module.split(".")[:2])) is None:
            continue
        command = getattr(import_module(module), definition)
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            app.command(name)(command)
