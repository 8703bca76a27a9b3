"""What the terminal says of volumes."""

from rich.markup import escape
from rich.table import Table

from photogram.report.client.volumes import volume_rows
from photogram.report.record.report import Report


def volume_table(report: Report) -> Table | None:
    """Return a short table of the key `volumes` of report.json, None where there are none."""
    rows = volume_rows(report)
    if not rows:
        return None
    table = Table(title="Volumes, m³, with 1 sigma")
    for name in ("polygon", "above the base", "below it", "above less below", "area, m²", "gaps, m²"):
        table.add_column(name, justify="left" if name == "polygon" else "right")
    for row in rows:
        areas = f"{row.area_m2:.1f}", f"{row.unmeasured_m2:.1f}"
        table.add_row(escape(row.name), row.above, row.below, row.net, *areas)
    return table
