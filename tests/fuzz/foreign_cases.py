"""Solutions of other programs that are spoilt, and what must hold where they are imported all the same."""

import shutil

from cases import Case, SilenceError, Target
from mutations import spoil_any

from photogram.exchange.formats.recognition import read_solution
from photogram.exchange.solution_import import import_solution
from photogram.files.solutions.solution import ForeignSolution
from photogram.pipeline.pipeline import load_project

FILES: dict[str, tuple[str, ...]] = {
    "colmap": ("cameras.bin", "images.bin", "points3D.bin"),
    "colmap-text": ("cameras.txt", "images.txt", "points3D.txt"),
    "opensfm": ("reconstruction.json", "tracks.csv", "reference_lla.json"),
    "bundler": ("bundle.out", "list.txt"),
    "metashape": ("cameras.xml",),
    "opf": (
        "project.opf", "camera-list.json", "input-cameras.json", "projected-input-cameras.json",
        "calibrated-cameras.json", "input-control-points.json", "projected-control-points.json",
        "scene-reference-frame.json", "tracks/tracks.gltf", "tracks/positions.bin", "tracks/matchCameraIds.bin",
        "tracks/matchPointIndexRanges.bin", "tracks/matchPixelCoordinates.bin",
    ),
    "blocks": ("block.xml",),
    "psz": ("project.psz",),
    "psx": ("project.psx", "project.files/project.zip", "project.files/0/chunk.zip", "project.files/0/0/frame.zip",
            "project.files/0/0/point_cloud/point_cloud.zip"),
    "micmac": ("AutoCal.xml", "Orientation-IMG_000.JPG.xml"),
    "meshroom": ("sfm.json",),
    "baf": ("scene.baf", "scene_imgList.txt"),
    "nvm": ("model.nvm",),
    "dbat": ("report.txt", "project.xml", "ties.txt", "marks.txt", "images.txt", "points.txt"),
    "pix4d": ("p_calibrated_camera_parameters.txt",),
    "stored": ("solution.npz",),
    "database": ("database.db",),
}  # fmt: skip
"""The files of each form that are spoilt."""
STATED = ("opensfm", "opf", "blocks")
"""Forms that name their CRS or place."""


def _counts(solution: ForeignSolution) -> dict[str, int]:
    posed = sum(photograph.pose is not None for photograph in solution.photographs)
    ground = 0 if solution.ground_points is None else len(solution.ground_points)
    observations = len(solution.tie_points.point)
    return {"poses": posed, "photographs": len(solution.photographs), "points": ground, "observations": observations}


def solution(case: Case) -> None:
    """Import a solution one file of which is spoilt; whatever a cut took away is named."""
    root = case.bench.corpus / "solutions"
    form = case.sound.relative_to(root).parts[0]
    folder = case.bench.folder.with_name("solution")
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(root / form, folder)
    place = folder / case.sound.relative_to(root / form)
    place.write_bytes(case.path.read_bytes())
    source = folder / "database.db" if form == "database" else folder
    crs = None if form in STATED else "none"
    import_solution(source, photographs=folder, project=folder / "own.yaml", crs=crs, force=True)
    load_project(folder / "own.yaml")
    if case.was_cut and form != "database":
        _check_nothing_is_lost(read_solution(root / form), read_solution(folder))


def _check_nothing_is_lost(sound: ForeignSolution, read: ForeignSolution) -> None:
    before, after = _counts(sound), _counts(read)
    lost = [f"{after[name]} of {before[name]} {name}" for name in before if after[name] < before[name]]
    if lost and len(read.left_out) <= len(sound.left_out):
        raise SilenceError(f"{', '.join(lost)} read from a file that was cut off")


TARGETS = {
    form: Target(tuple(f"solutions/{form}/{name}" for name in names), spoil_any, solution)
    for form, names in FILES.items()
}
CUT = tuple(TARGETS)
