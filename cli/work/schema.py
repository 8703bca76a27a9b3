"""What `photogram schema` does."""

import json
from collections.abc import Callable

import typer
from pydantic import TypeAdapter

from photogram.project.json_schema import project_schema
from photogram.report.record.json_schema import report_schema
from photogram.settings.json_schema import schema_of
from photogram.terminal.events import Event


def event_schema() -> dict[str, object]:
    """Return the JSON Schema of a line of ``--json``."""
    return schema_of(TypeAdapter(Event))


SCHEMAS: dict[str, Callable[[], dict[str, object]]] = {
    "report": report_schema,
    "events": event_schema,
    "project": project_schema,
}
"""By the name of the document."""


def run(document: str) -> None:
    """Print the JSON Schema of a document."""
    typer.echo(json.dumps(SCHEMAS[document](), indent=2))
