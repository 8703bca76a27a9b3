"""The types of report.json as a reader checks them, and as a JSON Schema for other programs."""

from functools import cache

from pydantic import TypeAdapter

from photogram.report.record.report import Report
from photogram.settings.json_schema import schema_of


@cache
def report_types() -> TypeAdapter[Report]:
    """Return what reads and checks report.json."""
    return TypeAdapter(Report)


def report_schema() -> dict[str, object]:
    """Return the JSON Schema of report.json."""
    return schema_of(report_types())
