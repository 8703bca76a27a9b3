"""What report.json says of components that share no matched tie points: what ties each to the block, and how well."""

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.report.record.block import ComponentRecord, ComponentSigmaRecord
from photogram.results import Adjustment
from photogram.sfm.orientation import Orientation
from photogram.survey import Block


def component_numbers(result: Adjustment, orientation: Orientation) -> list[ComponentRecord]:
    """Return what ties each component of a survey to the block, in the order of the orientation."""
    block, component = result.block, orientation.component
    count = int(component.max(initial=-1)) + 1
    ties = (*orientation.ties, *("",) * (count - len(orientation.ties)))
    shifts = result.covariances.deformation.component_shift_m2
    return [
        _tied(block, component, number, ties[number], _sigma(block, shifts[number]) if number < len(shifts) else None)
        for number in range(count)
    ]


def _sigma(block: Block, covariance_m2: FloatArray) -> ComponentSigmaRecord | None:
    """Return standard deviations along the axes of the map, None of the first component and of those without any."""
    if not covariance_m2.any() or np.isnan(covariance_m2).any():
        return None
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    variance = np.diag(axes.T @ covariance_m2 @ axes)
    return {"plan": float(np.sqrt(variance[:2].sum())), "height": float(np.sqrt(variance[2]))}


def _shared(of_photograph: IntArray, item: IntArray, count: int, component: IntArray, number: int) -> BoolArray:
    """Return which of ``count`` items photographs of a component and of another one show; observations (O,) are of
    photographs ``of_photograph`` and of items ``item``."""
    of = component[of_photograph]
    own, other = (
        np.bincount(item[chosen], minlength=count) > 0 for chosen in (of == number, (of >= 0) & (of != number))
    )
    return np.asarray(own & other)


def _tied(
    block: Block, component: IntArray, number: int, placed_by: str, sigma: ComponentSigmaRecord | None
) -> ComponentRecord:
    points, tie = block.control_points, block.tie_points
    own = component == number
    marked = np.bincount(points.mark_point[own[points.mark_photograph]], minlength=len(points)) > 0
    control = marked & (np.array(points.role, dtype=object) == "control")
    shared = _shared(points.mark_photograph, points.mark_point, len(points), component, number)
    elsewhere = (component >= 0) & ~own
    cameras = np.intersect1d(block.camera_of[own], block.camera_of[elsewhere])
    positions = np.array([p.gnss_world_m is not None for p in block.photographs], dtype=bool)
    ties = _shared(tie.photograph, tie.point, len(tie), component, number)
    return {
        "photographs": int(own.sum()),
        "adjusted": bool((own & block.registered).any()),
        "placed_by": placed_by,
        "control_points": [points.name[g] for g in np.flatnonzero(control)],
        "gnss_positions": int((own & positions).sum()),
        "shared_marks": [points.name[g] for g in np.flatnonzero(shared)],
        "shared_cameras": [block.cameras[c].name for c in cameras],
        "shared_tie_points": int(ties.sum()),
        "sigma_to_first_m": sigma,
    }
