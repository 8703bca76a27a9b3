"""What `photogram schema` does."""

from __future__ import annotations

import json
from collections.abc import Callable

import typer

from photogram.report.record.json_schema import report_schema

SCHEMAS: dict[str, Callable[[], dict[str, object]]] = {"report": report_schema}
"""By the name of the document."""


def run(document: str) -> None:
    """Print the JSON Schema of a document."""
    typer.echo(json.dumps(SCHEMAS[document](), indent=2, ensure_ascii=False))
