"""Factors as GTSAM takes them: one custom factor for each, with the residual and Jacobians that it has here."""

import gtsam
import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.factors.linearised.alike import Factors
from photogram.factors.variables import CONTROL_POINT, GNSS_OFFSET, POSE, TIE_POINT, kind_and_index

_POINTS = (CONTROL_POINT, GNSS_OFFSET, TIE_POINT)


class GtsamValues:
    """GTSAM's values of variables, as factors read them."""

    def __init__(self, values: gtsam.Values) -> None:
        self._values = values

    def poses(self, variables: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the rotations (n, 3, 3), world from camera, and projection centres (n, 3) of poses (n,)."""
        poses = [self._values.atPose3(variable) for variable in variables.tolist()]
        return np.array([p.rotation().matrix() for p in poses]), np.array([p.translation() for p in poses])

    def vectors(self, variables: IntArray) -> FloatArray:
        """Return the values (n, d) of variables (n,) of one kind that are no poses."""
        at = self._values.atPoint3 if kind_and_index(int(variables[0]))[0] in _POINTS else self._values.atVector
        return np.array([at(variable) for variable in variables.tolist()])

    def velocities(self, _: IntArray) -> None:
        """Return None: velocities are as given."""


def in_gtsam(factors: Factors) -> list[gtsam.NonlinearFactor]:
    """Return alike factors as GTSAM's, one by one."""
    return [_custom(factors.alone(n)) for n in range(len(factors))]


def _custom(one: Factors) -> gtsam.NonlinearFactor:
    kinds = one.kinds

    def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        read = GtsamValues(values)
        linear = one.linearised(read)
        if jacobians is not None:
            start = 0
            for k in range(len(kinds)):
                size = 6 if kinds[k] == POSE else read.vectors(one.variables[:, k]).shape[1]
                jacobians[k] = linear.jacobian[0, :, start : start + size]
                start += size
        return np.asarray(linear.misfit[0])

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(one.rows), one.variables[0].tolist(), error)
