"""What a read-out time can be taken for: its correlations with the focal length, and with a time offset of positions.

A read-out time stretches a picture along the flight, as the focal length does; an offset in time between exposures and
positions moves the photographs along it. With an unknown of which T is told only up to the correlation ρ, its standard
deviation is 1/√(1 − ρ²) times what it would be were that unknown held.

A time offset is an unknown only where the positions show one (photogram.adjustment.common_errors). Where it is none, it
is taken for one more: with the weights W of the positions, the velocities J at which it moves them, L = Σ Aᵀ W J and
the covariance Σ of all unknowns, its information is K = Σ Jᵀ W J − Lᵀ Σ L, its covariance with them Σ L / K, and theirs
grows by Σ L Lᵀ Σ / K (as in Rao's score test; Förstner & Wrobel 2016, sec. 4.6.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.adjustment.gnss_offsets import measured_positions
from photogram.arrays import BoolArray, FloatArray
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.projection import FOCAL, READOUT

INSEPARABLE = 0.95
"""Correlation from which a read-out time cannot be separated from the other unknown, which then accounts for nine
tenths of its variance and more."""
LEAST_SHARE = 1e-8
"""Of the information that the positions have on a time offset, the least share left by everything else that is unknown:
below it nothing but rounding is left."""


@dataclass(frozen=True, eq=False)
class Correlations:
    """Of the read-out times of cameras (C,) with their own ``focal_length`` and with a ``time_offset`` of exposures
    after positions; NaN where the read-out time or the other is held, or not told."""

    focal_length: FloatArray
    time_offset: FloatArray

    @staticmethod
    def unknown(cameras: int) -> Correlations:
        """Return what is known of ``cameras`` whose read-out times are all held."""
        return Correlations(np.full(cameras, np.nan), np.full(cameras, np.nan))

    def combined(self, others: Correlations, theirs: BoolArray) -> Correlations:
        """Return those of cameras of which some, ``theirs`` (C,), are in ``others``."""
        return Correlations(
            np.where(theirs, others.focal_length, self.focal_length),
            np.where(theirs, others.time_offset, self.time_offset),
        )

    def warnings(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return a sentence on each of the cameras of these ``names`` (C,) whose read-out time cannot be separated from
        another unknown."""
        sentences = list[str]()
        for name, focal, time in zip(names, self.focal_length.tolist(), self.time_offset.tolist(), strict=True):
            if abs(focal) >= INSEPARABLE:
                sentences.append(
                    f"Camera {name}: its read-out time cannot be separated from its focal length (correlation "
                    f"{focal:+.2f}): calibrate the camera, or fly strips across the others"
                )
            if abs(time) >= INSEPARABLE:
                sentences.append(
                    f"Camera {name}: its read-out time cannot be separated from a time offset between exposures and "
                    f"GNSS positions (correlation {time:+.2f}): fly strips to and fro, or give control points"
                )
        return tuple(sentences)


def correlations(problem: Problem, state: State, covariances: Covariances) -> Correlations:
    """Return the correlations of the read-out times that are free, at a solution with its covariances."""
    cameras = len(problem.block.cameras)
    focal, time = np.full(cameras, np.nan), np.full(cameras, np.nan)
    for c in range(cameras):
        covariance = covariances.calibration(c)
        if not covariance[READOUT, READOUT] > 0.0:
            continue
        time[c] = _with_time_offset(problem, state, covariances, c)
        if covariance[FOCAL, FOCAL] > 0.0:
            focal[c] = covariance[FOCAL, READOUT] / np.sqrt(covariance[FOCAL, FOCAL] * covariance[READOUT, READOUT])
    return Correlations(focal, time)


def _with_time_offset(problem: Problem, state: State, covariances: Covariances, camera: int) -> float:
    layout = covariances.layout
    owner, parameter = layout.free_parameters
    column = int(np.flatnonzero((owner == camera) & (parameter == READOUT))[0])
    variance = float(covariances.border[column, column])
    for k, error in enumerate(problem.block.common_errors):
        if error.kind == "time_offset" and error.camera in (None, camera):
            own = int(layout.columns_of_common(k)[0])
            return float(covariances.border[column, own] / np.sqrt(variance * covariances.border[own, own]))
    photographs, velocity = problem.block.photographs, state.cameras.velocity
    information, L = 0.0, np.zeros((layout.columns + layout.border, 1))
    for position in measured_positions(problem, state, layout):
        if photographs[position.photograph].camera == camera:
            weighted = position.weight @ velocity[position.photograph]
            information += float(velocity[position.photograph] @ weighted)
            L[position.columns, 0] += position.jacobian.T @ weighted
    moved = covariances.solve(L)
    left = information - float(L[:, 0] @ moved[:, 0])
    if not left > LEAST_SHARE * information:
        return float("nan")
    with_readout = float(moved[layout.columns + column, 0])
    return float(with_readout / np.sqrt(left * variance + with_readout**2))
