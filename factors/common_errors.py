"""What measurements of many photographs have in common: how an error q of a flight or a camera moves the positions and
turns the attitudes of its photographs.

A projection centre is C = GNSS + R (l + a) + o + v τ + d t, with the lever arm l that is given and the correction a of
it, along the camera's axes, the offset o of the flight, the time offset τ by which exposures come later than the epochs
of the positions, at the velocity v, and the drift d over a flight, whose time t goes from −1/2 to 1/2.

A measured attitude is Exp(h z) R Exp(b): b is the boresight, a turn about the camera's axes, h an error of the compass
about the vertical z. Where all photographs look straight down (or are tilted alike) h is one of the directions of b,
and only the priors separate the two: what is common to them is determined, and never singular.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.factors.linearised.rotations import attitude_misfits
from photogram.survey import Block, CommonError, Photograph

GAP = 3.0
"""Times the median interval of a flight, beyond which two photographs in succession are no neighbours."""
TURNING = 0.5
"""Share of the speed by which the velocities before and after an exposure differ in a turn."""
WHOLE_SECONDS_SIGMA_S = 0.41
"""Standard deviation of the difference of two times that were cut to whole seconds: 1/√6 s."""
COARSE = 0.2
"""Relative error of a velocity, from coarse times, beyond which it is not used."""


class Effect(NamedTuple):
    """How the error number ``error`` moves a position: by ``matrix`` (3, d) times its value, along the camera's axes or
    those of the world, m."""

    error: int
    in_camera: bool
    matrix: FloatArray

    def in_world(self, rotation_world_from_camera: FloatArray) -> FloatArray:
        """Return the matrix (3, d) along the axes of the world."""
        return np.asarray(rotation_world_from_camera @ self.matrix if self.in_camera else self.matrix)


def parts(errors: Sequence[CommonError]) -> tuple[slice, ...]:
    """Return where each error stands in the vector of all their values."""
    ends = np.cumsum([len(error.sigma) for error in errors], dtype=np.int64).tolist()
    return tuple(slice(end - len(error.sigma), end) for error, end in zip(errors, ends, strict=True))


def values_of(errors: Sequence[CommonError]) -> FloatArray:
    """Return the values of all errors, one after the other."""
    return np.concatenate([np.zeros(0), *(error.value for error in errors)])


def with_values(block: Block, values: FloatArray) -> tuple[CommonError, ...]:
    """Return the common errors of a block with other values, one after the other."""
    errors = block.common_errors
    return tuple(replace(error, value=values[part].copy()) for error, part in zip(errors, parts(errors), strict=True))


def _times_s(photographs: Sequence[Photograph]) -> FloatArray:
    """Return the times (N,) of exposure, s from the first, NaN where they are not known."""
    known = [p.time for p in photographs if p.time is not None]
    if not known:
        return np.full(len(photographs), np.nan)
    first = min(known, key=lambda time: time.timestamp()).timestamp()
    return np.array([np.nan if p.time is None else p.time.timestamp() - first for p in photographs])


def velocities(
    photographs: Sequence[Photograph], position_world_m: FloatArray | None = None, coarse: float = COARSE
) -> FloatArray:
    """Return the velocities (N, 3) in the world, m/s, from the positions before and after in a flight: the measured
    ones, or ``position_world_m`` (N, 3), NaN where there is none.

    NaN where there is no neighbour within GAP intervals, no time, or none fine enough: times in whole seconds give a
    velocity to a relative error that shall not be above ``coarse``. At the end of a strip the
    nearer neighbour in time counts alone.
    """
    velocity, time_s = np.full((len(photographs), 3), np.nan), _times_s(photographs)
    if position_world_m is None:
        measured = [np.full(3, np.nan) if p.gnss_world_m is None else p.gnss_world_m for p in photographs]
        position_world_m = np.array(measured).reshape(-1, 3)
    has = np.isfinite(position_world_m).all(axis=1) & np.isfinite(time_s)
    flights = np.array([p.flight for p in photographs])
    for flight in np.unique(flights[has]):
        own = np.flatnonzero(has & (flights == flight))
        own = own[np.argsort(time_s[own], kind="stable")]
        times = [photographs[i].time for i in own.tolist()]
        whole = all(time is not None and time.microsecond == 0 for time in times)
        velocity[own] = _velocities_of_flight(
            time_s[own], position_world_m[own], WHOLE_SECONDS_SIGMA_S if whole else 0.0, coarse
        )
    return velocity


def _velocities_of_flight(time_s: FloatArray, position: FloatArray, sigma_s: float, coarse: float) -> FloatArray:
    """Return the velocities (n, 3) at ascending times (n,) whose differences have a standard deviation of ``sigma_s``;
    see velocities."""
    velocity = np.full(position.shape, np.nan)
    step_s = np.diff(time_s)
    if not np.any(step_s > 0.0):
        return velocity
    near = (step_s > 0.0) & (step_s <= GAP * np.median(step_s[step_s > 0.0]))
    leg = np.diff(position, axis=0) / np.where(near, step_s, np.nan)[:, None]
    for i in range(len(time_s)):
        before, after = i > 0 and bool(near[i - 1]), i < len(leg) and bool(near[i])
        if not (before or after):
            continue
        if before and after:
            b = leg[i - 1]
            f = leg[i]
            s = float(step_s[i - 1])
            t = float(step_s[i])
            if np.linalg.norm(f - b) > TURNING * max(np.linalg.norm(f), np.linalg.norm(b)) and abs(s - t) > 0.2 * s:
                v, span_s = (b, s) if s < t else (f, t)
            else:
                v, span_s = (b * t + f * s) / (s + t), s + t
        else:
            v, span_s = (leg[i - 1], float(step_s[i - 1])) if before else (leg[i], float(step_s[i]))
        if sigma_s <= coarse * span_s:
            velocity[i] = v
    return velocity


def flight_time(photographs: Sequence[Photograph]) -> FloatArray:
    """Return the times (N,) of exposure in the duration of their flight, −1/2 to 1/2; NaN where they are not known."""
    time_s, flights = _times_s(photographs), np.array([p.flight for p in photographs])
    share = np.full(len(photographs), np.nan)
    for flight in np.unique(flights):
        own = (flights == flight) & np.isfinite(time_s)
        if own.any() and np.ptp(time_s[own]) > 0.0:
            share[own] = (time_s[own] - time_s[own].min()) / np.ptp(time_s[own]) - 0.5
    return share


def members(photographs: Sequence[Photograph], error: CommonError) -> BoolArray:
    """Return the photographs (N,) whose measurements have an error in common."""
    return np.array([error.of(photograph) for photograph in photographs], dtype=bool)


def designs(photographs: Sequence[Photograph], error: CommonError) -> FloatArray:
    """Return how an error of positions moves each of its photographs (N, 3, d): along the camera's axes for a lever
    arm, else along those of the world; NaN where the photograph is no member, or its velocity or time is not known."""
    count, d = len(photographs), len(error.sigma)
    design = np.full((count, 3, d), np.nan)
    own = members(photographs, error)
    if error.kind == "lever_arm":
        design[own] = error.basis
    elif error.kind == "time_offset":
        design[own] = velocities(photographs)[own][:, :, None]
    elif error.kind == "drift":
        design[own] = flight_time(photographs)[own][:, None, None] * np.eye(3)
    return design


def position_effects(block: Block) -> tuple[tuple[Effect, ...], ...]:
    """Return by photograph how the common errors of a block move its position."""
    effects: list[list[Effect]] = [[] for _ in block.photographs]
    for k, error in enumerate(block.common_errors):
        if error.kind in ("attitude", "known_surface"):
            continue
        design = designs(block.photographs, error)
        for i in np.flatnonzero(np.isfinite(design).all(axis=(1, 2))).tolist():
            effects[i].append(Effect(k, error.kind == "lever_arm", design[i]))
    return tuple(tuple(own) for own in effects)


def common_shifts(block: Block, values: FloatArray | None = None, rotations: FloatArray | None = None) -> FloatArray:
    """Return by how much the common errors move where GNSS puts the projection centres (N, 3), in the world, m; of
    other ``values``, and cameras of other ``rotations`` (N, 3, 3), than the block has."""
    values = values_of(block.common_errors) if values is None else values
    rotations = block.oriented_cameras().rotation if rotations is None else rotations
    shift, where = np.zeros((len(block.photographs), 3)), parts(block.common_errors)
    for i, effects in enumerate(position_effects(block)):
        for effect in effects:
            shift[i] += effect.in_world(rotations[i]) @ values[where[effect.error]]
    return shift


def attitude_errors(block: Block) -> tuple[int, ...]:
    """Return by photograph the number of the common error of its attitude, −1 for none."""
    number = np.full(len(block.photographs), -1)
    for k, error in enumerate(block.common_errors):
        if error.kind == "attitude":
            number[members(block.photographs, error)] = k
    return tuple(number.tolist())


class AttitudeGroup(NamedTuple):
    """Photographs (n,) whose attitudes have the common error of this number, −1 for none: their misfits (n, 3), rad,
    and the derivatives of these by the poses' turns (n, 3, 3) and by the ``bias`` (n, 3, d), as
    ``attitude_misfits`` has them."""

    photograph: IntArray
    error: int
    misfit_rad: FloatArray
    of_turn: FloatArray
    of_bias: FloatArray


def attitude_groups(block: Block, rotation: FloatArray, values: FloatArray) -> Iterator[AttitudeGroup]:
    """Yield the measured attitudes that have a standard deviation, by their common error, beside rotations (N, 3, 3) of
    the cameras and the values of the common errors."""
    given = [
        (i, p.attitude_world_from_camera)
        for i, p in enumerate(block.photographs)
        if p.attitude_world_from_camera is not None and p.attitude_sigma_rad is not None
    ]
    if not given:
        return
    index, measured = np.array([i for i, _ in given]), np.array([R for _, R in given])
    number, where = np.array(attitude_errors(block))[index], parts(block.common_errors)
    for error in np.unique(number).tolist():
        own = number == error
        bias = values[where[error]] if error >= 0 else np.zeros(0)
        turned = attitude_misfits(measured[own], rotation[index[own]], np.tile(bias, (int(own.sum()), 1)))
        yield AttitudeGroup(index[own], error, *turned)
