"""The table of commands: each row leads to a command of its name."""

from importlib import import_module
from importlib.machinery import ModuleSpec

import pytest
import typer
from typer.main import get_command

from photogram.cli import registry


def names_of(app: typer.Typer) -> set[str]:
    return set(get_command(app).commands)  # type: ignore[attr-defined]  # a group of commands


def test_every_row_is_a_command() -> None:
    app = typer.Typer()
    registry.register_commands(app)
    assert names_of(app) == set(registry.COMMANDS)
    for place in registry.COMMANDS.values():
        module, definition = place.split(":")
        assert getattr(import_module(module), definition).__module__ in (module, "typer.main"), place


def test_commands_of_a_wing_that_is_not_there_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_change(name: str) -> ModuleSpec | None:
        return None if name == "photogram.change" else ModuleSpec(name, None)

    monkeypatch.setattr(registry, "find_spec", without_change)
    app = typer.Typer()
    registry.register_commands(app)
    assert names_of(app) == set(registry.COMMANDS) - {"compare", "epochs", "volume"}
