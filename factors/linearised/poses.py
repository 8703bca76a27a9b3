"""Observations of poses: positions with lever arms and common errors, attitudes with their bias, distances."""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.factors.linearised.alike import Factors, Linearised, Values
from photogram.factors.linearised.rotations import attitude_misfits, cross
from photogram.factors.variables import POSE


@dataclass(frozen=True, eq=False)
class PositionFactors(Factors):
    """Positions of antennas: W (C − R (l + Σ M q) − Σ M' q' − p), on a pose and vectors q and q'.

    ``whitening`` W (n, r, 3), ``measured_world_m`` p (n, 3), ``arm_camera_m`` l (n, 3), ``matrices`` M or M' (n, 3, d)
    of each vector, and whether it is one M, ``in_camera``, along the camera's axes. Jacobians: on the pose
    W [R [l + Σ M q]×, R], from R Exp(ω) l = R l − R [l]× ω to first order (Barfoot 2017, eq. 7.16), −W R M on q and
    −W M' on q'.
    """

    whitening: FloatArray
    measured_world_m: FloatArray
    arm_camera_m: FloatArray
    matrices: tuple[FloatArray, ...] = ()
    in_camera: tuple[bool, ...] = ()

    @property
    def rows(self) -> int:
        """Return how many observations each factor has."""
        return int(self.whitening.shape[1])

    def linearised(self, values: Values) -> Linearised:
        """Return the factors linearised at values."""
        R, C = values.poses(self.variables[:, 0])
        arm, shift, columns = self.arm_camera_m, self.measured_world_m, []
        for M, turning, variables in zip(self.matrices, self.in_camera, self.variables[:, 1:].T, strict=True):
            moved = np.einsum("nij,nj->ni", M, values.vectors(variables))
            arm, shift = (arm + moved, shift) if turning else (arm, shift + moved)
            columns.append(-(R @ M if turning else M))
        jacobian = np.concatenate([R @ cross(arm), R, *columns], axis=2)
        misfit = C - np.einsum("nij,nj->ni", R, arm) - shift
        return Linearised(np.einsum("nri,ni->nr", self.whitening, misfit), self.whitening @ jacobian)


@dataclass(frozen=True, eq=False)
class AttitudeFactors(Factors):
    """Measured attitudes, with the bias of a second variable or without: W Log(R̃ᵀ Exp(h z) R Exp(b)).

    ``whitening`` W (n, 3, 3) about the axes of the camera as measured, ``measured_world_from_camera`` R̃ (n, 3, 3).
    """

    whitening: FloatArray
    measured_world_from_camera: FloatArray

    @property
    def rows(self) -> int:
        """Return how many observations each factor has."""
        return 3

    def linearised(self, values: Values) -> Linearised:
        """Return the factors linearised at values."""
        biased = self.variables.shape[1] > 1
        bias = values.vectors(self.variables[:, 1]) if biased else np.zeros((len(self), 0))
        R, _ = values.poses(self.variables[:, 0])
        e, of_turn, of_bias = attitude_misfits(self.measured_world_from_camera, R, bias)
        jacobian = np.concatenate([of_turn, np.zeros_like(of_turn), of_bias], axis=2)
        return Linearised(np.einsum("nri,ni->nr", self.whitening, e), self.whitening @ jacobian)


@dataclass(frozen=True, eq=False)
class DistanceFactors(Factors):
    """Distances between two places, projection centres or points: (|X' − X| − ``length_m`` (n,)) / ``sigma_m`` (n,)."""

    length_m: FloatArray
    sigma_m: FloatArray

    @property
    def rows(self) -> int:
        """Return how many observations each factor has."""
        return 1

    def linearised(self, values: Values) -> Linearised:
        """Return the factors linearised at values."""
        (first, of_first), (second, of_second) = (_places(values, end) for end in self.variables.T)
        apart = second - first
        length = np.linalg.norm(apart, axis=1)
        along = (apart / (length * self.sigma_m)[:, None])[:, None, :]
        jacobian = np.concatenate([-along @ of_first, along @ of_second], axis=2)
        return Linearised(((length - self.length_m) / self.sigma_m)[:, None], jacobian)


def _places(values: Values, variables: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return where variables (n,) of one kind are (n, 3), and how that moves with them (n, 3, d)."""
    if int(variables[0]) >> 56 == ord(POSE):
        R, C = values.poses(variables)
        return C, np.concatenate([np.zeros_like(R), R], axis=2)
    return (X := values.vectors(variables)), np.broadcast_to(np.eye(3), (len(X), 3, 3))
