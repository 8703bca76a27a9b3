"""The stage `features`: key points of every photograph, how coarse they are, and the share that masks leave out."""

from dataclasses import replace
from pathlib import Path
from statistics import median

from typing_extensions import TypedDict

from photogram.errors import ImageError
from photogram.files.npz_json import write_json
from photogram.files.records import read_record, write_record
from photogram.machine import within_half_of_memory
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import Costs, Extent, Memory, Rate
from photogram.pipeline.stages.photographs import stretches
from photogram.pipeline.store.pieces import PieceType, StageWork, run_pieces, stage_work
from photogram.pipeline.store.run import Run
from photogram.project.project import Project
from photogram.project.schema import REDUCTIONS
from photogram.sfm.orientation import OrientationSettings
from photogram.sfm.tie_points.features import coarseness, find_features, search_bytes
from photogram.sfm.tie_points.guided_matching import TransferSettings
from photogram.survey import Features
from photogram.wording import Progress, percent, some, things

NOT_NEEDED = "the tie points are those of the solution that the project starts from"
"""Why such a project has neither key points nor matches of its own."""

MASKED = "masked.json"
"""File of the stage `features` with the share that masks leave out of each photograph; not there without masks."""


class FeaturesSummary(TypedDict, total=False):
    """What the stage says of itself."""

    key_points: list[int]
    """Number of key points of each photograph."""
    not_needed: str
    """Why there are none."""
    masks: int
    """Number of photographs with a mask, if any."""
    masked_share: float
    """Mean share that their masks leave out, if there are any."""


def starts_from_tie_points(project: Project) -> bool:
    """Return whether the tie points of a project are those of the solution that it starts from."""
    return project.start is not None and project.start.tie_points == "theirs"


def coarseness_of(project: Project, photograph: int) -> float:
    """Return how much coarser than with ``quality: high`` the picture is in which key points of a photograph are
    found."""
    camera = project.cameras[project.photographs[photograph].camera]
    return coarseness(camera.width_px * camera.height_px, project.features, REDUCTIONS[project.quality])


MOST_SEARCHED = 2.0
"""Times that transferred tie points are searched for farther away than with full quality, at most: beyond it windows
are found in the wrong place, and the time grows with the square."""


def _coarsest(project: Project) -> float:
    return max(coarseness_of(project, i) for i in range(len(project.photographs)))


def orientation_thresholds(project: Project) -> OrientationSettings:
    """Return the settings of the orientation, their threshold as coarse as key points are."""
    return replace(project.orientation, threshold_px=_coarsest(project) * project.orientation.threshold_px)


def transfer_thresholds(project: Project) -> TransferSettings:
    """Return the settings of the transfer: places are searched for around poses as coarse as key points are."""
    farther = min(_coarsest(project), MOST_SEARCHED)
    return replace(project.transfer, search_px=round(farther * project.transfer.search_px))


def _bytes_of_one(project: Project) -> float:
    """Return what the search in one photograph takes in memory, of the camera whose takes most."""
    reduction = REDUCTIONS[project.quality]
    return max(search_bytes(c.width_px, c.height_px, project.features, reduction) for c in project.cameras)


def detect_features(run: Run, folder: Path, progress: Progress) -> FeaturesSummary:
    """Find key points, one file per photograph; photographs that an interrupted run has finished are kept. None are
    needed where the project starts from tie points.

    As many photographs at once as there are workers and as the memory holds. Raises ImageError that names every
    photograph without enough of them.
    """
    masked = masked_shares(run, folder)
    given = starts_from_tie_points(run.project)
    at_once = within_half_of_memory(_bytes_of_one(run.project))
    counts, errors = list[int](), dict[str, str]()
    photographs = range(0 if given else len(run.names))
    for index, count in enumerate(run_pieces(run, folder, _DETECTED, photographs, at_once=at_once)):
        if isinstance(count, str):
            errors[run.names[index]] = count
        else:
            counts.append(count)
        progress(index + 1, len(photographs), run.names[index])
    if len(errors) > 1:
        raise ImageError(
            f"no features, or too few to match, were detected in {len(errors)} of {len(photographs)} photographs "
            f"({some(list(errors))}): they are blank, blurred or black; remove them, or lower "
            "features.contrast_threshold"
        )
    if errors:
        raise ImageError(*errors.values())
    summary: FeaturesSummary = {"not_needed": NOT_NEEDED} if given else {"key_points": counts}
    if masked is not None:
        write_json(folder / MASKED, masked)
        summary["masks"], summary["masked_share"] = len(masked), sum(masked.values()) / max(len(masked), 1)
    return summary


def _masked_share(work: StageWork, index: int) -> float | str:
    """Return the share of a photograph that its masks leave out, or what is wrong with them."""
    try:
        used = work[0].given_mask(index)
    except ImageError as error:
        return str(error)
    return 0.0 if used is None else 1.0 - float(used.mean())


_MASKED = PieceType(stage_work, _masked_share)


def masked_shares(run: Run, folder: Path) -> dict[str, float] | None:
    """Decode all masks that are given, before anything is looked for, and return the share that they leave out of each
    photograph that has one; None where none has. Raises ImageError that names every mask that cannot be used."""
    masked = [i for i in range(len(run.names)) if run.project.masks.of(i)]
    if not masked:
        return None
    shares = list(run_pieces(run, folder, _MASKED, masked))
    errors = [share for share in shares if isinstance(share, str)]
    if errors:
        raise ImageError("\n".join(dict.fromkeys(errors)))
    return {run.names[i]: share for i, share in zip(masked, shares, strict=True) if not isinstance(share, str)}


def _detect(work: StageWork, index: int) -> int | str:
    """Find the key points of a photograph, unless that is done; returns their number, or why it has too few."""
    run, folder = work
    path = folder / f"{index:05d}.npz"
    if not path.is_file():
        settings, reduction = run.project.features, REDUCTIONS[run.project.quality]
        pixels, used = run.pixels(index), run.given_mask(index)
        try:
            features = find_features(run.names[index], pixels, settings, reduction, used)
        except ImageError as error:
            return str(error)
        write_record(path, features)
    return len(read_record(path, Features))


_DETECTED = PieceType(stage_work, _detect)


def stored_features(run: Run, index: int) -> Features:
    """Return the key points of one photograph. Needs the stage `features`."""
    return read_record(run.workspace.file("features", f"{index:05d}.npz"), Features)


def _words(summary: FeaturesSummary) -> str:
    counts, masks = summary["key_points"], summary.get("masks", 0)
    text = f"{median(counts):.0f} key points per photograph (median)" if counts else "no key points"
    return f"{text}, {things(masks, 'mask')} of {percent(summary['masked_share'])} on average" if masks else text


def _settings(run: Run) -> object:
    project = run.project
    none = ["not needed"] if starts_from_tie_points(project) else []
    masks = [run.mask_fingerprints] if project.masks.given else []
    return [run.photograph_fingerprints, project.features, project.quality, *none, *masks, *stretches(run)]


AT_ONCE = 0.7
"""Share of the workers that hold the most at the same time."""


def _memory(extent: Extent) -> Memory:
    return Memory(_bytes_of_one(extent.project) * max(1.0, AT_ONCE * extent.workers))


FEATURES: Stage = Stage(
    "features",
    "Features",
    (),
    _settings,
    detect_features,
    line_of(FeaturesSummary, _words),
    Costs(
        0.05,
        (Rate("search", 1.0, "features"), Rate("megapixels", 0.02)),
        is_tested=True,
        disk_bytes=lambda extent: extent.key_point_bytes,
        memory=_memory,
    ),
)
