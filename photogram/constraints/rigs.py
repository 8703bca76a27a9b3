"""Cameras fixed to one body: the pose of a companion relative to its master, and which photographs are one exposure.

With master R, X and companion R', X' (world from camera, projection centres), offset o and rotation M (master from
companion): R' = R M and X' = X + R o. What is estimated are a rotation vector ρ and a correction δ of the relative pose
M₀, o₀ that is given: M = M₀ Exp(ρ), o = o₀ + δ.
"""

from __future__ import annotations

from collections.abc import Container, Hashable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray

MOST_COMPARED = 50
"""Exposures that are looked at as the middle of the others: with half of them gross, one of them still is not."""

SCALING = 4.0
"""Standard deviations of an offset, beyond which its length says how long a metre is."""


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Where a companion sits on the body of its master."""

    offset_m: FloatArray
    """Projection centre (3,) of the companion in the master's camera frame: x right, y down, z forward."""
    rotation_master_from_companion: FloatArray
    """Rotation (3, 3) from the companion's camera frame to the master's."""

    def __post_init__(self) -> None:
        if self.offset_m.shape != (3,) or self.rotation_master_from_companion.shape != (3, 3):
            raise ValueError("a relative pose is an offset (3,) and a rotation (3, 3)")

    def companions(self, rotation: FloatArray, position_world_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (n, 3, 3), world from camera, and positions (n, 3) of the companion from the master's."""
        return rotation @ self.rotation_master_from_companion, position_world_m + rotation @ self.offset_m

    @property
    def is_known(self) -> bool:
        """Return whether both offset and rotation are known."""
        return bool(np.isfinite(self.offset_m).all() and np.isfinite(self.rotation_master_from_companion).all())

    def moved(self, value: FloatArray) -> RelativePose:
        """Return the relative pose changed by a value (6,): ρ (rad), then δ (m)."""
        turn = Rotation.from_rotvec(value[:3]).as_matrix()
        return RelativePose(self.offset_m + value[3:], self.rotation_master_from_companion @ turn)

    def misfits(self, rotation: FloatArray, offset_m: FloatArray) -> FloatArray:
        """Return by how much relative poses (n, 3, 3), (n, 3) differ from this one, (n, 6).

        A rotation vector (rad) in the companion's camera frame, and an offset (m) in the master's.
        """
        turn = Rotation.from_matrix(self.rotation_master_from_companion.T @ rotation).as_rotvec()
        return np.hstack([turn, offset_m - self.offset_m])


def relative_poses(
    master: tuple[FloatArray, FloatArray], companion: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return rotations (n, 3, 3), master from companion, and offsets (n, 3) in the master's camera frame, in metres.

    Each camera is given by rotations (n, 3, 3), world from camera, and positions (n, 3) in the world.
    """
    turned = np.swapaxes(master[0], -1, -2)
    return turned @ companion[0], np.einsum("nij,nj->ni", turned, companion[1] - master[1])


def middle_of(rotation: FloatArray, offset_m: FloatArray) -> RelativePose:
    """Return a relative pose amid those of exposures (n, 3, 3), (n, 3), which a few gross ones do not move: medians of
    the offsets, and of the rotation vectors from that one which is nearest to the others."""
    turns = Rotation.from_matrix(rotation)
    apart = [float(np.median((turn.inv() * turns).magnitude())) for turn in turns[:MOST_COMPARED]]
    nearest = turns[int(np.argmin(apart))]
    turn = np.median((nearest.inv() * turns).as_rotvec(), axis=0)
    return RelativePose(np.median(offset_m, axis=0), (nearest * Rotation.from_rotvec(turn)).as_matrix())


@dataclass(frozen=True, eq=False)
class Companion:
    """A camera that is fixed to a master on one body, with the exposures that both have taken."""

    name: str
    """Name of the companion camera."""
    master: str
    """Name of the master camera."""
    given: RelativePose | None
    """The relative pose that is given, or from which a free one starts; None, or NaN in offset or rotation, where that
    starts from the poses."""
    sigma: FloatArray
    """Standard deviations (6,) of its rotation, rad, and of its offset, m; infinite where it is free."""
    exposures: tuple[tuple[str, str], ...]
    """Names of the companion's photograph and of the master's, of each exposure (n)."""
    exposure_sigma: FloatArray
    """Standard deviations (n, 6) by which the relative pose of an exposure scatters, rad and m: the body bends,
    shutters open at different times. Infinite where the two photographs were not taken together."""
    value: FloatArray = field(default_factory=lambda: np.zeros(6))
    """The estimated change (6,) of the given relative pose: ρ, rad, and δ, m."""

    def __post_init__(self) -> None:
        if self.sigma.shape != (6,) or self.value.shape != (6,):
            raise ValueError("a relative pose has six unknowns")
        if self.exposure_sigma.shape != (len(self.exposures), 6):
            raise ValueError("every exposure needs six standard deviations")

    @property
    def pose(self) -> RelativePose | None:
        """Return the relative pose as it is estimated, None while not all of it has a start."""
        return None if self.given is None or not self.given.is_known else self.given.moved(self.value)


def rejecting_exposures(rigs: Sequence[Companion], rejected: Container[str]) -> tuple[Companion, ...]:
    """Return the companions without the exposures of these photographs of theirs: their sigmas are infinite."""
    return tuple(
        replace(
            rig,
            exposure_sigma=np.where(
                np.array([[name in rejected] for name, _ in rig.exposures], dtype=bool).reshape(-1, 1),
                np.inf,
                rig.exposure_sigma,
            ),
        )
        for rig in rigs
    )


def exposure_names(rigs: Sequence[Companion]) -> list[tuple[str, str]]:
    """Return the names of the photographs, companion's and master's, of all exposures, rig after rig."""
    return [names for rig in rigs for names in rig.exposures]


def exposure_sigmas(rigs: Sequence[Companion]) -> FloatArray:
    """Return the standard deviations (E, 6), rad and m, of all exposures, rig after rig."""
    return np.concatenate([np.zeros((0, 6)), *(rig.exposure_sigma for rig in rigs)])


def give_scale(rigs: Sequence[Companion]) -> bool:
    """Return whether a baseline between cameras is given, so that lengths are in metres."""
    return any(
        rig.given is not None
        and np.isfinite(rig.exposure_sigma).all(axis=1).any()
        and bool(np.linalg.norm(rig.given.offset_m) > SCALING * np.linalg.norm(rig.sigma[3:]))
        for rig in rigs
    )


@dataclass(frozen=True)
class Exposures:
    """Photographs by number, grouped to exposures of one rig."""

    companion_master: tuple[tuple[int, int], ...]
    """Each companion that has a master, and that master, in the order of the companions."""
    without_master: tuple[int, ...]
    """Companions of whose exposure there is no photograph of the master."""


def exposures(cameras: Sequence[str], keys: Sequence[Hashable | None], master: str) -> Exposures:
    """Group the photographs of one rig by the key of their exposure, None where it is not known: a capture id, say.

    Raises ValueError where one camera has two photographs with the same key.
    """
    places: dict[tuple[str, Hashable], int] = {}
    for photograph, (camera, key) in enumerate(zip(cameras, keys, strict=True)):
        if key is not None and places.setdefault((camera, key), photograph) != photograph:
            raise ValueError(f"two photographs of camera {camera} have the exposure {key}")
    pairs: list[tuple[int, int]] = []
    alone: list[int] = []
    for photograph, (camera, key) in enumerate(zip(cameras, keys, strict=True)):
        if camera != master:
            of_master = places.get((master, key)) if key is not None else None
            if of_master is None:
                alone.append(photograph)
            else:
                pairs.append((photograph, of_master))
    return Exposures(tuple(pairs), tuple(alone))
