"""What the terminal says of a finished survey: short tables and sentences of report.json."""

from collections.abc import Mapping

from rich.markup import escape
from rich.table import Table

from photogram.report.client.volumes import volume_sentences
from photogram.report.record.diagnosis import DiagnosisRecord
from photogram.report.record.positions import GnssRecord
from photogram.report.record.report import Report, oriented
from photogram.report.record.surfaces import CloudRecord
from photogram.report.titles import ASSUMED_SIGMAS, CLOUD_TITLES
from photogram.results import SIGMA_TITLES
from photogram.terminal.console import console
from photogram.terminal.surface_table import surface_table
from photogram.terminal.volume_table import volume_table
from photogram.wording import percent

MAXIMUM_SENTENCES = 4
MAXIMUM_SUSPECTS = 5
MAXIMUM_LEFT_OUT = 10


def _fixed(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _resections(report: Report) -> Table | None:
    resected = {
        name: (photograph["resection"], photograph["sigma_m"])
        for name, photograph in oriented(report["photographs"]).items()
        if "resection" in photograph and "gnss_difference_m" in photograph["resection"]
    }
    if not resected or len(resected) > 20:
        return None
    table = Table(title="Exterior orientation: P3P, refined resection, sigmas after the adjustment")
    table.add_column("photograph", no_wrap=True)
    for title in ("P3P–GNSS m", "check px", "refined–GNSS m", "σE m", "σN m", "σH m"):
        table.add_column(title, justify="right")
    for name, (resection, sigma_m) in resected.items():
        check = resection["check_px"]
        refined = resection["refined"]["gnss_difference_m"]
        table.add_row(
            name,
            _fixed(resection["gnss_difference_m"]),
            "–" if check is None else f"{check:.1f}",
            _fixed(refined),
            *(_fixed(s) for s in sigma_m),
        )
    return table


def _block(report: Report) -> Table:
    block = report["block"]
    table = Table("figure", "value", title="Block", show_header=False)
    table.add_row("photographs oriented", f"{block['registered']} of {block['photographs']}, by {block['method']}")
    components = block["component_ties"]
    if len(components) > 1:
        parts = [f"{c['photographs']} ({c['placed_by'] if c['adjusted'] else 'not in the result'})" for c in components]
        table.add_row("components without common tie points", f"{', '.join(parts)} photographs")
    if block["gsd_m"] is not None:
        table.add_row("ground sampling distance", f"{block['gsd_m'] * 100:.2f} cm")
    overlap = block["overlap"]
    if overlap is not None:
        of = f"{overlap['area_m2']:.0f} m² that 2 or more show"
        seen = f"median {overlap['median']:.0f}, 3 or more on {percent(overlap['share_3_or_more'])} of {of}"
        table.add_row("overlap, photographs", seen)
    if block["mean_track_length"] is not None:
        table.add_row("mean track length", f"{block['mean_track_length']:.2f} photographs per tie point")
    rms = block["gnss_residual_rms_m"]
    if rms["three_d"] is not None:
        table.add_row("GNSS residual RMS in plan, height", f"{rms['plan']:.3f}, {rms['height']:.3f} m")
    return table


def _left_out(report: Report) -> Table | None:
    missing = [(name, p["reason"]) for name, p in report["photographs"].items() if not p["registered"]]
    if not missing:
        return None
    table = Table("photograph", "why", title=f"Not oriented: {len(missing)} photographs")
    for name, reason in missing[:MAXIMUM_LEFT_OUT]:
        table.add_row(escape(name), escape(reason))
    if len(missing) > MAXIMUM_LEFT_OUT:
        table.add_row(f"and {len(missing) - MAXIMUM_LEFT_OUT} more", "see photographs in report.json")
    return table


def show_gnss(gnss: GnssRecord) -> None:
    """Print what GNSS says of itself: who took part, offsets that are significant, warnings."""
    if not gnss["flights"] and not gnss["warnings"]:
        return
    if gnss["flights"]:
        kinds = ", ".join(f"{n} {kind}" for kind, n in gnss["solutions"].items() if n)
        console.print(f"[bold]GNSS:[/bold] {escape(gnss['sentence'])} Solutions: {kinds}.")
        datum = gnss.get("datum")
        if datum is not None:
            console.print(f"[bold]GNSS:[/bold] {escape(datum['sentence'])}")
    significant = [
        f["sentence"] for f in gnss["flights"].values() if f["significant"] and f["sentence"] not in gnss["warnings"]
    ]
    significant += [e["sentence"] for e in gnss.get("common_errors", []) if e["significant"]]
    for sentence in significant[:MAXIMUM_SENTENCES]:
        console.print(f"[bold]GNSS:[/bold] {escape(sentence)}")
    for sentence in gnss["warnings"][:MAXIMUM_SENTENCES]:
        console.print(f"[bold yellow]Warning:[/bold yellow] {escape(sentence)}")
    more = len(significant[MAXIMUM_SENTENCES:]) + len(gnss["warnings"][MAXIMUM_SENTENCES:])
    if more:
        console.print(f"and {more} more sentences, see gnss in report.json")


def _consistency(report: Report) -> list[str]:
    """Return what check points say of the prediction, and which sigmas the survey refutes as too small."""
    achieved = report["predicted_against_achieved"]
    prediction = [f"Predicted against achieved, {achieved['sentence']}"] if achieved is not None else []
    components = report["variance_components"].values()
    refuted = [c for c in components if c["significant"] and (c["sigma_factor"] or 0.0) > 1.0]
    return prediction + [f"Stated sigmas: {c['sentence']}" for c in refuted]


def _result(report: Report) -> Table:
    a = report["adjustment"]
    table = Table("figure", "value", title="Result", show_header=False)
    table.add_row("tie points, observations", f"{a['tie_points']}, {a['observations']}")
    table.add_row("discarded observations", str(a["discarded_observations"]))
    table.add_row("reprojection RMS", f"{_fixed(a['reprojection_rms_px'])} px")
    table.add_row("sigma0 (a priori 1)", _fixed(a["sigma0"]))
    for group in report.get("estimated_sigmas", [])[:MAXIMUM_SENTENCES]:
        unit, title = group["unit"], SIGMA_TITLES[group["kind"]]
        stated, used = _fixed(group["stated_sigma"]), _fixed(group["used_sigma"])
        how = "assumed" if group["kind"] in ASSUMED_SIGMAS else "stated"
        of = "" if title.lower().startswith(group["of"]) else f", {group['of']}"
        table.add_row(f"sigma: {title}{of}", f"{used} {unit} ({how} {stated})")
    table.add_row(
        "converged", f"{'yes' if a['converged'] else 'NO'}, {a['iterations']} iterations in {a['seconds']:.1f} s"
    )
    for name, camera in report["cameras"].items():
        sigma = camera["sigma"]["focal_px"]
        table.add_row(
            f"focal length, {name}",
            f"{camera['focal_px']:.2f} px" + (" (fixed)" if sigma is None else f" ± {sigma:.2f}"),
        )
    table.add_row(*_accuracy(report))
    for title, figures in _against_targets(report):
        table.add_row(title, figures)
    unused = [p["name"] for p in report["control_points"] if p["role"] == "check" and p["adjusted_map_m"] is None]
    if unused:
        table.add_row("check points without two intersecting marks", ", ".join(unused))
    return table


def _accuracy(report: Report) -> tuple[str, str]:
    """Return what tests the accuracy, and what it found."""
    check, left = report["check_points"], report["leave_one_out"]
    if check["n"]:
        by, plan_m, height_m = f"check points ({check['n']})", check["rmse_h_m"], check["rmse_v_m"]
    elif left is not None:
        by, plan_m, height_m = f"leave-one-out ({left['n']}, no check points)", left["rmse_h_m"], left["rmse_v_m"]
    else:
        return "check points", "none: the accuracy is predicted, not tested"
    return f"{by}: RMSE in plan, height", f"{_fixed(plan_m)}, {_fixed(height_m)} m"


def _against_targets(report: Report) -> list[tuple[str, str]]:
    """Return what ASPRS adds to the accuracy at check points, the uncertainty of their survey, and the targets."""
    tested = [f for f in report["verdict"]["figures"] if f["n"]]
    sums = [f["asprs_rmse_m"] for f in report["verdict"]["figures"]]
    targets = [f["target_m"] for f in report["verdict"]["figures"]]
    rows = list[tuple[str, str]]()
    if any(rmse_m is not None for rmse_m in sums):
        rows.append(("together with their survey (ASPRS)", f"{', '.join(map(_fixed, sums))} m"))
    if any(f["asprs_rmse_m"] is None for f in tested):
        rows.append(("accuracy of their survey", "only assumed: enter it as sigma_m, and remove sigma_assumed"))
    if tested and any(target_m is not None for target_m in targets):
        rows.append(("targets in plan, height", f"{', '.join(map(_fixed, targets))} m"))
    return rows


def _show_blunders(report: Report) -> None:
    for blunder in report["blunders"]:
        console.print(f"[bold red]Rejected:[/bold red] {escape(blunder['sentence'])}")
    if report["blunders_effect"] and report["blunders_effect"]["sentence"]:
        sentence = report["blunders_effect"]["sentence"]
        console.print(escape(sentence[0].upper() + sentence[1:]))


def _show_focal_lengths(report: Report) -> None:
    for name, camera in report["cameras"].items():
        if camera["focal_length"]:
            console.print(
                f"[bold yellow]Focal length of {escape(name)}:[/bold yellow] {escape(camera['focal_length'])}"
            )


def _show_suspects(report: Report) -> None:
    # what one blunder spreads to its neighbours is suspected too
    suspects = [s for s in report["suspects"] if not report["blunders"] or s["kind"] == "GNSS position"]
    for n, suspect in enumerate(suspects[:MAXIMUM_SUSPECTS]):
        also = "" if n == 0 else " (may be an effect of the first)"
        console.print(f"[bold]Suspect:[/bold] {escape(suspect['sentence'])}{also}")


def _show_diagnosis(diagnosis: DiagnosisRecord) -> None:
    for sentence in diagnosis["warnings"]:
        console.print(f"[bold]Weak:[/bold] {escape(sentence)}")
    if diagnosis["warnings"] and diagnosis["remedies"]:
        console.print(f"[bold]Most effective improvement:[/bold] {escape(diagnosis['remedies'][0]['sentence'])}")
    for resections in diagnosis["resections"]:
        console.print(escape(resections["sentence"]))


def _over_reference(clouds: Mapping[str, CloudRecord]) -> Table | None:
    if all(cloud["nmad_m"] is None for cloud in clouds.values()):
        return None
    table = Table("cloud", "points", "mean, m", "st. dev., m", "NMAD, m", title="Height over the reference")
    for name, cloud in clouds.items():
        spread = (_fixed(value) for value in (cloud["mean_m"], cloud["std_m"], cloud["nmad_m"]))
        table.add_row(CLOUD_TITLES[name], str(cloud["points"]), *spread)
    return table


def show_report(report: Report) -> None:
    """Print the essentials of report.json."""
    local = report.get("local_frame")
    if local is not None:
        console.print(f"[bold]Local frame:[/bold] {escape(local['sentence'])}.", soft_wrap=True)
    if local is not None and not local["scale_known"]:  # most of what follows is in metres
        _show_tables(_left_out(report), _result(report))
        _show_blunders(report)
        _show_focal_lengths(report)
        console.print(f"[bold]{escape(report['verdict']['sentence'])}[/bold]", soft_wrap=True)
        return
    _show_tables(_resections(report), _block(report), _left_out(report), _result(report))
    _show_blunders(report)
    _show_focal_lengths(report)
    for sentence in _consistency(report):
        console.print(escape(sentence))
    show_gnss(report["gnss"])
    known = report.get("known_surface")
    if known is not None:
        console.print(escape(known["sentence"]), soft_wrap=True)
    _show_suspects(report)
    _show_diagnosis(report["diagnosis"])
    _show_tables(surface_table(report), volume_table(report), _over_reference(report["clouds"]))
    for sentence in volume_sentences(report):
        console.print(escape(sentence), soft_wrap=True)
    console.print(f"[bold]{escape(report['verdict']['sentence'])}[/bold]", soft_wrap=True)


def _show_tables(*tables: Table | None) -> None:
    for table in tables:
        if table is not None:
            console.print(table)
