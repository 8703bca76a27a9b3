"""What the terminal says of the dense surface."""

from rich.table import Table

from photogram.report.record.positions import is_placed_by_prior
from photogram.report.record.report import Report
from photogram.report.record.surfaces import DenseRecord, OrthophotoCheckRecord
from photogram.wording import percent


def surface_table(report: Report) -> Table | None:
    """Return a short table of the keys `dense` and `orthophoto` of report.json, None where neither was made."""
    dense, orthophoto = report.get("dense"), report.get("orthophoto")
    if dense is None and orthophoto is None:
        return None
    made = orthophoto is not None and "left_out" not in orthophoto
    title = "Orthophoto" if not dense else "Surface and orthophoto" if made else "Surface"
    table = Table("figure", "value", title=title, show_header=False)
    if "plane" in report and report["plane"]["used"]:
        plane = report["plane"]
        table.add_row("on a plane", f"{plane['tilt_deg']:.1f}° from level, of {plane['points']} tie points: plane.json")
    if dense is not None:
        _add_surface(table, dense)
        table.add_row("predicted sigma of heights, median", _predicted(report, dense))
        _add_surface_test(table, dense)
    if orthophoto is not None and "left_out" in orthophoto:
        table.add_row("orthophoto", f"left out: {orthophoto['left_out']}")
    elif orthophoto is not None:
        size = f"{orthophoto['cell_m']:.3f} m, {orthophoto['columns']} × {orthophoto['rows']} cells"
        table.add_row("orthophoto, cell", f"{size}, {percent(orthophoto['covered'])} covered")
        rim = orthophoto["rim"]
        table.add_row(
            "orthophoto, within its rim", f"{rim['area_m2']:.0f} m², {percent(rim['transparent'], 2)} transparent"
        )
        if "check_points" in orthophoto:
            _add_orthophoto_test(table, orthophoto["check_points"])
    return table


def _add_surface(table: Table, dense: DenseRecord) -> None:
    table.add_row("cell", f"{dense['cell_m']:.3f} m, {dense['columns']} × {dense['rows']} cells")
    areas, share = dense["areas"], dense["completeness"]
    parts = {"measured": areas["measured_m2"], "filled": areas["filled_m2"], "water": areas["water_m2"]}
    told = [f"{m2:.0f} m² {name}" for name, m2 in parts.items() if m2]
    told.append(f"{areas['interpolated_m2']:.0f} m² interpolated over holes")
    table.add_row("mapped, seen by two photographs or more", f"{areas['mapped_m2']:.0f} m²: {', '.join(told)}")
    if areas["left_out_m2"]:
        table.add_row("not mapped", f"{areas['left_out_m2']:.0f} m² seen only obliquely and coarsely")
    if share is not None and areas["seen_3_or_more_m2"] is not None:
        of = f"{areas['seen_3_or_more_m2']:.0f} m² that three photographs or more show"
        table.add_row("completeness", f"{percent(share, 1)} measured of {of}")


def _predicted(report: Report, dense: DenseRecord) -> str:
    """Return the predicted sigma in words: relative, where nothing but a prior tells the absolute one."""
    dsm, gnss = report.get("dsm"), report.get("gnss")
    relative = None if dsm is None or "left_out" in dsm else dsm["relative_sigma_m"]
    if relative is not None and gnss is not None and is_placed_by_prior(gnss):
        figures = f"{relative['median']:.3f} m, 95 % below {relative['percentile_95']:.3f} m"
        return f"{figures}, relative to each other; absolute height is not determined: only the prior of GNSS tells it"
    sigma = dense["sigma_m"]
    return "–" if sigma is None else f"{sigma['median']:.3f} m, 95 % below {sigma['percentile_95']:.3f} m"


def _add_surface_test(table: Table, dense: DenseRecord) -> None:
    check = dense["check_points"]
    if check["rmse_m"] is None:
        table.add_row("surface at check points", f"{check['n']} on the surface: too few to test it")
    else:
        table.add_row(
            f"surface at check points ({check['n']}): RMSE, mean of the heights",
            f"{check['rmse_m']:.3f}, {check['mean_m']:+.3f} m; {check['rms_z']:.2f} times their sigmas",
        )


def _add_orthophoto_test(table: Table, check: OrthophotoCheckRecord) -> None:
    if check["fit_rmse_h_m"] is None or check["mean_m"] is None:
        table.add_row("orthophoto at check points", f"{check['n']} targets found in it: too few to test it")
        return
    east, north = check["mean_m"]
    title = f"orthophoto at check points ({check['n']} found): RMSE, mean in plan"
    table.add_row(title, f"{check['fit_rmse_h_m']:.3f} m; {east:+.3f}, {north:+.3f} m")
