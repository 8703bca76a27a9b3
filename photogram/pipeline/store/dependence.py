"""What stages depend on beside each other, as values for fingerprints.

Control points reach two stages only loosely. They help to choose the origin of the frame, which serves as long as it
lies amid the survey; and they place in the world a block that was oriented from its tie points, which the adjustment
does again. What was made with other control points then holds, under the settings that it was made under
(``photographs_as_made``, ``orientation_as_made``).
"""

from dataclasses import replace
from pathlib import Path

from photogram.files.npz_json import file_fingerprint, fingerprint, read_json
from photogram.geodesy.frames import LocalFrame
from photogram.pipeline.store.run import FRAME, PLACED_BY, Run
from photogram.project.measured.measured_block import is_amid
from photogram.project.project import Project


def control_fingerprint(project: Project) -> str:
    """Return the fingerprint of the project's ground points with their roles and marks."""
    return fingerprint(project.control_points_in(LocalFrame(project.crs, (0.0, 0.0, 0.0), "grid")))


def height_marks(project: Project) -> list[object]:
    """Return the height systems as declared: the grid of a geoid counts by what is in it."""
    heights, geoid = project.heights, project.heights.geoid
    grid = None if geoid is None or geoid.grid is None else file_fingerprint(Path(geoid.grid))
    return [heights.output, heights.gnss, heights.gnss_given, None if geoid is None else geoid.vertical, grid]


def placing_fingerprint(project: Project) -> str:
    """Return the fingerprint of the control coordinates that help to choose the origin of the frame."""
    return fingerprint([p.control_map_m for p in project.surveyed.control_points if p.role == "control"])


def _photographs(run: Run, placing: str) -> object:
    project = run.project
    return [
        run.photograph_fingerprints,
        project.cameras,
        # but for where they lie: a moved folder changes nothing
        [replace(p, path=Path(p.name)) for p in project.photographs],
        project.crs,
        project.world_kind,
        height_marks(project),
        None if project.datum.grid is None else file_fingerprint(Path(project.datum.grid)),
        placing,
        *([project.rigs] if project.rigs else []),  # companions are measured by their masters
    ]


def photographs_settings(run: Run) -> object:
    """Return what the stage `photographs` depends on."""
    return _photographs(run, placing_fingerprint(run.project))


def photographs_as_made(run: Run) -> object | None:
    """Return what the stage `photographs` was made under where its frame still serves, None where it does not, or is
    not there."""
    if run.workspace.mark("photographs") is None or not run.workspace.has("photographs", FRAME):
        return None
    frame = read_json(run.workspace.file("photographs", FRAME))
    return _photographs(run, frame["placed_by"]) if is_amid(frame["origin_map_m"], run.project, run.notes()) else None


def starts_from_tie_points(project: Project) -> bool:
    """Return whether the tie points of a project are those of the solution that it starts from."""
    return project.start is not None and project.start.tie_points == "theirs"


def tie_points_settings(run: Run) -> object:
    """Return what the stage `tie_points` depends on."""
    start, sigma_px = run.project.start, run.project.adjustment.tie_point_sigma_px
    return sigma_px if start is None or start.tie_points == "own" else [sigma_px, file_fingerprint(start.solution)]


def stretches(run: Run) -> list[object]:
    """Return what stages depend on that read pixels of more than 8 bits; nothing in a project without such."""
    return [run.stretches] if run.stretches else []


def given_masks(run: Run) -> list[object]:
    """Return what stages depend on that leave masked pixels out; nothing in a project without masks."""
    return [run.mask_fingerprints] if run.project.masks.given else []


def automatic_masks(project: Project) -> list[object]:
    """Return what is masked in photographs automatically; nothing in a project that asks for none."""
    return [("sky",)] if "sky" in project.masks.auto else []


def surface_settings(run: Run) -> object:
    """Return what the stage `surface` depends on."""
    surface = run.project.surface
    return [surface, "water"] if "water" in run.project.masks.auto else surface


def _known_poses(project: Project) -> list[object]:
    start = project.start
    return [] if start is None or start.poses == "own" else [file_fingerprint(start.solution)]


def orientation_settings(run: Run) -> object:
    """Return what the stage `orientation` depends on."""
    return [run.project.orientation, control_fingerprint(run.project), *_known_poses(run.project)]


def orientation_as_made(run: Run) -> object | None:
    """Return what the stage `orientation` was made under where every pose came from tie points, whatever the control
    points now are; None where one came from control points, or the stage is not there."""
    if run.workspace.mark("orientation") is None or not run.workspace.has("orientation", PLACED_BY):
        return None
    placed = run.georeferenced_by()
    return None if placed.poses else [run.project.orientation, placed.control, *_known_poses(run.project)]
