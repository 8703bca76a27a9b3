"""The smooth correction field of a camera: its functions at the nodes of a lattice, and what is known of it beforehand.

A lens is smooth: of a field of a given RMS the coefficients have prior standard deviations that fall with the degree d
of their function as 1 / (1 + d)², the smoothness prior of least squares collocation on a polynomial basis (Moritz 1980,
sec. 10). Between the nodes the field is bilinear (Munjy 1986), in the adjustment as in everything that is made from it.
"""

from dataclasses import replace

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, LensField
from photogram.lens.field_basis import field_basis

DEGREE = 6
"""Of a field's functions: of simulated lens patterns of up to four half waves it leaves a fifth."""

ROWS, COLUMNS = 49, 65
"""Nodes over a picture."""


def nodes_px(camera: Camera) -> FloatArray:
    """Return the pixels (R, Q, 2) of the nodes of a camera's field, from edge to edge of the picture."""
    u, v = (np.linspace(0.0, side, n) - 0.5 for side, n in ((camera.width_px, COLUMNS), (camera.height_px, ROWS)))
    return np.stack(np.meshgrid(u, v), axis=-1)


def prior_sigmas(degree: IntArray, rms_px: float) -> FloatArray:
    """Return the standard deviations (K,), px, of the coefficients of functions of ``degree`` (K,) in a field that is
    expected to have an RMS of ``rms_px`` for a coordinate."""
    sigma = 1.0 / (1.0 + degree) ** 2
    return np.asarray(rms_px * sigma / np.sqrt(np.sum(sigma**2)))


def free_field(camera: Camera, rms_px: float) -> LensField:
    """Return a field of zero that is expected to have an RMS of ``rms_px`` for a coordinate, free of what the
    parameters of the camera describe."""
    bare = replace(camera, field=None)
    basis, nodes = field_basis(bare, DEGREE), nodes_px(camera)
    functions = basis.at(nodes.reshape(-1, 2)).reshape(ROWS, COLUMNS, 2, len(basis))
    return LensField(np.ascontiguousarray(functions), np.zeros(len(basis)), prior_sigmas(basis.degree, rms_px))


def rms_px(field: LensField) -> float:
    """Return the RMS of a field for a coordinate over the picture, px."""
    return float(np.sqrt(np.sum(np.square(field.coefficients))))


def rms_sigma_px(coefficient_covariance: FloatArray) -> float:
    """Return the RMS over the picture of the standard deviation of a field for a coordinate, px, from the covariance
    (K, K) of its coefficients."""
    return float(np.sqrt(np.trace(coefficient_covariance)))
