"""The types of report.json as a reader checks them, and as a JSON Schema for other programs."""

from __future__ import annotations

from functools import cache
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import CoreSchema

from photogram.report.record.report import Report

DIALECT = "https://json-schema.org/draft/2020-12/schema"


class _WithoutTitles(GenerateJsonSchema):
    """Titles of keys would only repeat them."""

    def field_title_should_be_set(self, schema: CoreSchema) -> bool:  # noqa: ARG002
        return False


@cache
def report_types() -> TypeAdapter[Report]:
    """Return what reads and checks report.json."""
    return TypeAdapter(Report)


def schema_of(types: TypeAdapter[Any]) -> dict[str, object]:
    """Return the JSON Schema (draft 2020-12) of documents of such types."""
    return {"$schema": DIALECT, **types.json_schema(schema_generator=_WithoutTitles)}


def report_schema() -> dict[str, object]:
    """Return the JSON Schema of report.json."""
    return schema_of(report_types())
