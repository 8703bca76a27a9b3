"""Numbers of the marks of ground points: by the way they were measured, and of each point."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from photogram.report.record.ground import GroundPointRecord, MarkKindRecord, MarkRecord, SpreadRecord

UNKNOWN = "unknown"
"""Kind of marks in a report that does not say how they were measured."""

LEAST_REDUNDANCY = 1.0
"""Sum of redundancy numbers from which on residuals say anything of the sigmas."""


def mark_kind_numbers(points: Iterable[GroundPointRecord]) -> list[MarkKindRecord]:
    """Return the marks of ground points by kind, the most frequent first."""
    of_kind: dict[str, list[MarkRecord]] = {}
    of_control = Counter[str]()
    for point in points:
        for mark in point["marks"]:
            kind = mark.get("kind", UNKNOWN)
            of_kind.setdefault(kind, []).append(mark)
            of_control[kind] += point["role"] == "control"
    ordered = sorted(of_kind.items(), key=lambda entry: (-len(entry[1]), entry[0]))
    return [record for kind, marks in ordered if (record := _of_kind(kind, marks, of_control[kind])) is not None]


def _of_kind(kind: str, marks: Sequence[MarkRecord], of_control_points: int) -> MarkKindRecord | None:
    spread = _spread([mark["sigma_px"] for mark in marks if "sigma_px" in mark])
    if spread is None:
        return None
    fitted = [(mark, *at) for mark in marks if (at := _residual_and_whitened(mark)) is not None]
    squares_px2 = [residual**2 for _, px, _ in fitted for residual in px]
    scaled = [value**2 for _, _, whitened in fitted for value in whitened]
    return {
        "kind": kind,
        "marks": len(marks),
        "of_control_points": of_control_points,
        "rejected": sum(mark["left_out"] for mark in marks),
        "sigma_px": spread,
        "residual_rms_px": _root_mean(squares_px2),
        "residual_over_sigma": _root_mean(scaled),
        "sigma_factor": _sigma_factor([(mark, whitened) for mark, _, whitened in fitted if mark["redundancy"]]),
    }


def _residual_and_whitened(mark: MarkRecord) -> tuple[list[float], list[float]] | None:
    """Return the residual of a mark that says how well marks fit, px, and its parts along the axes of its ellipse in
    sigmas of each; None of others."""
    if mark["left_out"] or mark["residual_px"] is None or "sigma_px" not in mark:
        return None
    u, v = mark["residual_px"]
    if "semi_axes_px" not in mark:
        return [u, v], [u / mark["sigma_px"], v / mark["sigma_px"]]
    major_px, minor_px = mark["semi_axes_px"]
    c, s = math.cos(math.radians(mark["direction_deg"])), math.sin(math.radians(mark["direction_deg"]))
    return [u, v], [(c * u + s * v) / major_px, (c * v - s * u) / minor_px]


def _spread(values: Sequence[float]) -> SpreadRecord | None:
    if not values:
        return None
    return {"median": float(np.median(values)), "least": min(values), "largest": max(values)}


def _root_mean(squares: Sequence[float]) -> float | None:
    return math.sqrt(math.fsum(squares) / len(squares)) if squares else None


def _sigma_factor(fitted: Sequence[tuple[MarkRecord, list[float]]]) -> float | None:
    """Return by what the stated sigmas would be multiplied to fit the residuals: the root of the sum of (v / sigma)²
    over the sum of redundancy numbers, which is a variance component by its first iteration."""
    redundancy = math.fsum(r for mark, _ in fitted for r in mark["redundancy"] or () if r is not None)
    if redundancy < LEAST_REDUNDANCY:
        return None
    return math.sqrt(math.fsum(v**2 for _, whitened in fitted for v in whitened) / redundancy)


# ---- of each point -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PointMarks:
    """The marks of a point in short, for people."""

    name: str
    """Name of the point."""
    role: str
    """Its role."""
    marks: int
    """Number of marks."""
    rejected: int
    """Number of those that the adjustment has rejected."""
    largest: MarkRecord | None
    """The mark with the largest residual of those that were not rejected, None where none has a residual."""
    is_flagged: bool
    """Whether a mark is rejected or suspect."""

    @property
    def largest_px(self) -> float | None:
        """Return the length of the largest residual."""
        return None if self.largest is None else residual_length_px(self.largest)

    @property
    def w(self) -> float | None:
        """Return the larger w-test of the mark with the largest residual, None where it is not tested."""
        return None if self.largest is None else largest_w(self.largest)


def residual_length_px(mark: MarkRecord) -> float | None:
    """Return the length of a mark's residual, None where it has none."""
    return None if mark["residual_px"] is None else math.hypot(*mark["residual_px"])


def largest_w(mark: MarkRecord) -> float | None:
    """Return the w-test of a mark that is farther from zero, None where it is not tested."""
    return max((w for w in mark["w"] or () if w is not None), key=abs, default=None)


def by_misfit(marks: Iterable[MarkRecord]) -> list[MarkRecord]:
    """Return marks with those first that fit worst: rejected ones, then by their residuals."""
    return sorted(marks, key=lambda mark: (not mark["left_out"], -(residual_length_px(mark) or 0.0)))


def point_marks(points: Iterable[GroundPointRecord]) -> list[PointMarks]:
    """Return the marks of each point that has any."""
    rows = []
    for point in points:
        kept = [mark for mark in by_misfit(point["marks"]) if not mark["left_out"] and mark["residual_px"] is not None]
        rejected = sum(mark["left_out"] for mark in point["marks"])
        flagged = rejected > 0 or any(mark["suspect"] for mark in point["marks"])
        if point["marks"]:
            largest = kept[0] if kept else None
            rows.append(PointMarks(point["name"], point["role"], len(point["marks"]), rejected, largest, flagged))
    return rows
