"""The types of report.json as a reader checks them, and as a JSON Schema for other programs."""

from __future__ import annotations

from functools import cache

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


def report_schema() -> dict[str, object]:
    """Return the JSON Schema (draft 2020-12) of report.json."""
    return {"$schema": DIALECT, **report_types().json_schema(schema_generator=_WithoutTitles)}
