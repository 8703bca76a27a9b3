"""What the terminal says of the dense surface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table


def surface_table(report: Mapping[str, Any]) -> Table | None:
    """Return a short table of the key `dense` of report.json, None where no dense surface was made."""
    dense = report.get("dense")
    if dense is None:
        return None
    table = Table("figure", "value", title="Surface", show_header=False)
    table.add_row("cell", f"{dense['cell_m']:.3f} m, {dense['columns']} × {dense['rows']} cells")
    cells, share = dense["cells"], dense["completeness"]
    filled = f", {cells['filled']} filled" if cells["filled"] else ""
    complete = "–" if share is None else f"{share:.1%} of {cells['footprint']} cells{filled}"
    table.add_row("completeness", complete)
    sigma = dense["sigma_m"]
    predicted = "–" if sigma is None else f"{sigma['median']:.3f} m, 95 % below {sigma['percentile_95']:.3f} m"
    table.add_row("predicted sigma of heights, median", predicted)
    check = dense["check_points"]
    if check["rmse_m"] is None:
        table.add_row("check points", f"{check['n']} on the surface: too few to test it")
    else:
        table.add_row(
            f"check points ({check['n']}): RMSE, mean of the heights",
            f"{check['rmse_m']:.3f}, {check['mean_m']:+.3f} m; {check['rms_z']:.2f} times their sigmas",
        )
    return table
