"""What a drafted project file assumes because nothing states it, and what becomes of it."""

from collections.abc import Iterator
from pathlib import PurePath
from typing import NamedTuple

from photogram.geodesy.crs import NO_CRS
from photogram.project.draft.draft import ProjectDraft
from photogram.project.draft.positions import AUTONOMOUS_M
from photogram.project.draft.text import ATTITUDE_SIGMA_DEG, DEFAULT_CONTROL_SIGMA_M, DEFAULT_MARK_SIGMA_PX


class Assumption(NamedTuple):
    """``what`` is assumed, as which ``value``, and what becomes of it."""

    what: str
    value: str
    becomes: str


def assumptions(draft: ProjectDraft) -> Iterator[Assumption]:
    """Yield what is assumed in a draft, in the order of the project file."""
    positioned = any(p.gnss is not None for p in draft.photographs)
    if not draft.height_systems.known and draft.crs != NO_CRS:
        becomes = "the results name no height system"
        if positioned and any(file.role == "control" for file in draft.control):
            becomes = "the photographs tell by how much GNSS and control points differ"
        yield Assumption("heights", "not declared", becomes)
    for camera in draft.cameras:
        if camera.sigmas[0] > 0.0:
            value = f"{camera.focal_px:.0f} ± {camera.sigmas[0]:.0f} px, {camera.source}"
            yield Assumption(f"focal length of {camera.name}", value, "estimated; a contradiction is reported")
        if camera.shutter is not None and camera.shutter.sigma_s > 0.0:
            size = f"{1e3 * camera.shutter.readout_s:.0f} ± {1e3 * camera.shutter.sigma_s:.0f} ms"
            becomes = "estimated where the photographs show it"
            yield Assumption(f"read-out time of {camera.name}", size, becomes)
    if draft.gnss_kinds.get("without stated accuracy"):
        east, _, up = AUTONOMOUS_M
        value = f"{east:g} m in plan, {up:g} m in height"
        yield Assumption("GNSS positions", value, "estimated from what they scatter by")
    if positioned:
        value = ", ".join(f"{sigma:g}" for sigma in draft.offset_sigma_m) + " m"
        told = any(file.role == "control" for file in draft.control)
        becomes = "estimated by the control points" if told else "undetermined: included in the absolute accuracy"
        yield Assumption("what a flight's positions are off by together", value, becomes)
    if any(p.has_attitude for p in draft.photographs):
        yield Assumption("attitudes", f"{ATTITUDE_SIGMA_DEG:g}°", "what they are off by together is estimated")
    for file in draft.control:
        if not file.has_sigmas and file.sigma_m is None:
            value = ", ".join(f"{sigma:g}" for sigma in DEFAULT_CONTROL_SIGMA_M) + " m"
            becomes = "estimated from what they scatter by" if file.role == "control" else "not used for accuracy"
            yield Assumption(f"points of {PurePath(file.path).name}", value, becomes)
        if not file.lacks_marks:
            becomes = "estimated from what they scatter by"
            yield Assumption(
                f"marks of {PurePath(file.path if file.has_marks else file.marks or '').name}",
                f"{DEFAULT_MARK_SIGMA_PX:g} px",
                becomes,
            )
