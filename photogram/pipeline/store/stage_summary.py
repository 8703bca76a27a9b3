"""What a stage says of itself when it is done: seconds and counts, as stored in ``stage.json`` and told to watchers."""

from __future__ import annotations

from functools import cache

from pydantic import TypeAdapter
from typing_extensions import TypedDict


class StageSummary(TypedDict, total=False):
    """What a stage says of itself. Each stage gives some of the keys, named with each; the first six are of all.

    A watcher is told them as the stage made them, before anything is stored; where the stage was done before, as they
    are stored.
    """

    stage: str
    """Name of the stage, as stored."""
    fingerprint: str
    """Fingerprint of its settings and inputs, as stored."""
    format: int
    """Format of the files, as stored."""
    seconds: float
    """Time that it took, as stored, s."""
    compilation_seconds: float
    """Part of it in which kernels were compiled, as stored, s; 0 but for a first run on a machine."""
    peak_memory_bytes: int | None
    """Highest memory of the process, as stored; None where the system cannot tell."""

    photographs: int
    """photographs, orthophoto: number of photographs read, or used."""
    copies: int
    """photographs: number of copies left out, if any."""
    frozen_positions: int
    """photographs: number of positions of a stopped receiver, if any."""
    key_points: list[int]
    """features: number of key points of each photograph."""
    not_needed: str
    """features, pairs, matches: why there are none."""
    masks: int
    """features: number of photographs with a mask, if any."""
    masked_share: float
    """features: mean share that their masks leave out, if there are any."""
    pairs: int
    """pairs, matches: number of pairs selected."""
    selected_by: dict[str, int]
    """pairs: number of pairs by the reason for which they were selected."""
    verified_pairs: int
    """matches: number of pairs with verified matches."""
    tie_points: int
    """tie_points, transfer: number of tie points."""
    conflicts: int
    """tie_points: number of contradictory tie points rejected."""
    method: str
    """orientation: method that found the starting poses."""
    registered: int
    """orientation: number of photographs oriented."""
    resected: int
    """orientation: number of photographs resected from control points."""
    disagreeing: int
    """transfer: number of observations that disagree with the oriented block."""
    transferred: int
    """transfer: number of further observations."""
    sky: int
    """transfer: number of photographs in which sky is masked, where that is asked for."""
    linear_2view: int
    """intersection: number of points from two views."""
    linear_3view: int
    """intersection: number of points from three views."""
    sigma0: float | None
    """adjustment: a-posteriori standard deviation of unit weight; without redundancy NaN, as stored None."""
    converged: bool
    """adjustment: whether the adjustment converged."""
    blunders: int
    """adjustment: number of blunders rejected."""
    iterations: int
    """adjustment: number of iterations."""
    disbelieved_headings: int
    """adjustment: number of headings of the gimbal not used."""
    disbelieved_attitudes: int
    """adjustment: number of attitudes of the gimbal not used."""
    rows: int
    """dense, surface, orthophoto: rows of the grid."""
    columns: int
    """dense, surface, orthophoto: columns of the grid."""
    cell_m: float
    """dense, surface, orthophoto: size of a cell."""
    levels: int
    """dense: number of levels of the pyramid."""
    measured_of_grid: int
    """surface: number of cells that were matched."""
    filled_of_grid: int
    """surface: number of cells that were filled."""
    water_of_grid: int
    """surface: number of cells that lie on water, where that is asked for."""
    least_correlation: float
    """surface: least correlation of a cell that is kept."""
    interpolated: int
    """relief: number of cells of the terrain that were interpolated."""
    contours: int
    """relief: number of contour lines."""
    interval_m: float
    """relief: contour interval."""
    of: str
    """relief: what the contour lines are of, terrain or surface."""
    cells: int
    """orthophoto: number of cells that are shown."""
    transparent: int
    """orthophoto: number of cells within its rim that are not shown."""
    least_factor: float
    """orthophoto: least factor of the brightness of a photograph, mean of the channels."""
    greatest_factor: float
    """orthophoto: greatest factor of the brightness of a photograph, mean of the channels."""
    left_out: str
    """surface, relief, orthophoto: why there is none."""
    clouds: int
    """comparison: number of clouds compared."""
    products: list[str]
    """results: names of the files in the folder of results."""


@cache
def _types() -> TypeAdapter[StageSummary]:
    return TypeAdapter(StageSummary)


def summary_from(value: object) -> StageSummary:
    """Return a summary as it was stored; keys of nothing above are left out. Raises ValueError where it is something
    else."""
    return _types().validate_python(value, strict=True)
