"""Exposures of cameras on one body, as observations of their relative pose.

With the poses R, X of the master and R', X' of the companion (world from camera), and the relative pose M = M₀ Exp(ρ),
o = o₀ + δ, an exposure has the misfits

    e = Log(Mᵀ Rᵀ R') (rad, about the companion's axes)   and   d = Rᵀ (X' − X) − o (m, along the master's axes).

Poses move by R Exp(ω) and X + R v. With J⁻¹ the inverse right Jacobian of SO(3) at e and J that at ρ (Chirikjian 2012,
sec. 10.86; Forster et al. 2017, eq. 8–9), E = Exp(e) and Q = Rᵀ R':

    ∂e/∂ω' = J⁻¹     ∂e/∂ω = −J⁻¹ Qᵀ              ∂e/∂ρ = −J⁻¹ Eᵀ J
    ∂d/∂v' = Q       ∂d/∂ω = [Rᵀ (X' − X)]×       ∂d/∂v = −I       ∂d/∂δ = −I
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.constraints.rigs import Companion, RelativePose, exposure_names, exposure_sigmas
from photogram.factors.linearised.alike import Factors, Linearised, Values, VectorFactors
from photogram.factors.linearised.rotations import cross, inverse_right_jacobian, right_jacobian
from photogram.factors.priors import vector_prior
from photogram.factors.variables import POSE, RIG, key
from photogram.survey import Block


@dataclass(frozen=True, eq=False)
class TakingPart:
    """The exposures (E) that take part: the numbers of their ``rig``, of the photographs of ``master`` and
    ``companion``, of themselves among all exposures of the block (``number``), their ``sigma`` (E, 6), rad and m, and
    the ``given`` relative pose of every rig (K,)."""

    rig: IntArray
    master: IntArray
    companion: IntArray
    number: IntArray
    sigma: FloatArray
    given_rotation: FloatArray
    given_offset_m: FloatArray

    def __len__(self) -> int:
        return len(self.rig)

    @property
    def pairs(self) -> IntArray:
        """Return the photographs (E, 2) that they join."""
        return np.column_stack([self.master, self.companion])

    def select(self, keep: BoolArray) -> TakingPart:
        """Return the exposures of the mask (E,)."""
        return replace(
            self,
            rig=self.rig[keep],
            master=self.master[keep],
            companion=self.companion[keep],
            number=self.number[keep],
            sigma=self.sigma[keep],
        )


def taking_part(block: Block) -> TakingPart:
    """Return the exposures of a block of which both photographs are in it, and that are not rejected."""
    numbers = {photograph.name: i for i, photograph in enumerate(block.photographs)} if block.rigs else {}
    names = exposure_names(block.rigs)
    companion = np.array([numbers.get(name, -1) for name, _ in names], dtype=np.int64)
    master = np.array([numbers.get(name, -1) for _, name in names], dtype=np.int64)
    rig = np.repeat(np.arange(len(block.rigs)), [len(r.exposures) for r in block.rigs]).astype(np.int64)
    sigma = exposure_sigmas(block.rigs)
    given = [r.given or RelativePose(np.zeros(3), np.eye(3)) for r in block.rigs]
    every = TakingPart(
        rig,
        master,
        companion,
        np.arange(len(rig)),
        sigma,
        np.array([g.rotation_master_from_companion for g in given]).reshape(-1, 3, 3),
        np.array([g.offset_m for g in given]).reshape(-1, 3),
    )
    return every.select((companion >= 0) & (master >= 0) & np.isfinite(sigma).all(axis=1))


def estimated(block: Block) -> IntArray:
    """Return the numbers (K,) of the rigs whose relative poses are unknowns: those with an exposure that takes part."""
    return np.unique(taking_part(block).rig)


def rig_values(block: Block) -> FloatArray:
    """Return the values (6 K,) of the relative poses that are unknowns, one after the other."""
    return np.concatenate([np.zeros(0), *(block.rigs[k].value for k in estimated(block).tolist())])


def values_by_rig(block: Block, common: FloatArray) -> FloatArray:
    """Return the values (rigs, 6) of all relative poses, from those of the common unknowns, at whose end they stand;
    what is no unknown keeps its own."""
    values = np.array([rig.value for rig in block.rigs]).reshape(-1, 6)
    own = estimated(block)
    values[own] = common[len(common) - 6 * len(own) :].reshape(-1, 6)
    return values


def with_rig_values(block: Block, common: FloatArray) -> tuple[Companion, ...]:
    """Return the rigs of a block with the relative poses of the common unknowns."""
    values = values_by_rig(block, common) if block.rigs else ()
    return tuple(replace(rig, value=value.copy()) for rig, value in zip(block.rigs, values, strict=True))


def misfits(exposures: TakingPart, rotation: FloatArray, position: FloatArray, value: FloatArray) -> FloatArray:
    """Return the misfits (E, 6), rad and m, of photographs (N, 3, 3), (N, 3) and relative poses (rigs, 6)."""
    return _compared(exposures, rotation, position, value)[0]


def whitened_exposures(block: Block, rotation: FloatArray, position: FloatArray, common: FloatArray) -> FloatArray:
    """Return the misfits (E, 6) of all exposures of a block in their standard deviations, NaN for what takes no part,
    of photographs (N, 3, 3), (N, 3) and the common unknowns."""
    every = taking_part(block)
    whole = np.full((len(exposure_names(block.rigs)), 6), np.nan)
    if len(every):
        whole[every.number] = misfits(every, rotation, position, values_by_rig(block, common)) / every.sigma
    return whole


def _compared(
    exposures: TakingPart, rotation: FloatArray, position: FloatArray, value: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the misfits (E, 6), the rotations Rᵀ R' (E, 3, 3) and the offsets Rᵀ (X' − X) (E, 3)."""
    master = np.swapaxes(rotation[exposures.master], 1, 2)
    Q = master @ rotation[exposures.companion]
    d = np.einsum("nij,nj->ni", master, position[exposures.companion] - position[exposures.master])
    own = value[exposures.rig]
    M = exposures.given_rotation[exposures.rig] @ Rotation.from_rotvec(own[:, :3]).as_matrix()
    e = Rotation.from_matrix(np.swapaxes(M, 1, 2) @ Q).as_rotvec()
    return np.hstack([e, d - exposures.given_offset_m[exposures.rig] - own[:, 3:]]), Q, d


def linearised(exposures: TakingPart, rotation: FloatArray, position: FloatArray, value: FloatArray) -> Linearised:
    """Return the exposures linearised at photographs (N, 3, 3), (N, 3) and relative poses (rigs, 6)."""
    misfit, Q, d = _compared(exposures, rotation, position, value)
    e, rho = misfit[:, :3], value[exposures.rig][:, :3]
    inverse, E = inverse_right_jacobian(e), Rotation.from_rotvec(e).as_matrix()
    jacobian = np.zeros((len(exposures), 6, 18))
    jacobian[:, :3, 0:3] = -inverse @ np.swapaxes(Q, 1, 2)
    jacobian[:, :3, 6:9] = inverse
    jacobian[:, :3, 12:15] = -inverse @ np.swapaxes(E, 1, 2) @ right_jacobian(rho)
    jacobian[:, 3:, 0:3] = cross(d)
    jacobian[:, 3:, 3:6] = -np.eye(3)
    jacobian[:, 3:, 9:12] = Q
    jacobian[:, 3:, 15:18] = -np.eye(3)
    return Linearised(misfit / exposures.sigma, jacobian / exposures.sigma[:, :, None])


@dataclass(frozen=True, eq=False)
class ExposureFactors(Factors):
    """Exposures on the poses of master and companion and on the relative pose: ``sigma`` (n, 6), rad and m, and the
    given relative poses (n, 3, 3), (n, 3) of their rigs."""

    sigma: FloatArray
    given_rotation: FloatArray
    given_offset_m: FloatArray

    @property
    def rows(self) -> int:
        """Return how many observations each exposure has."""
        return 6

    def linearised(self, values: Values) -> Linearised:
        """Return the exposures linearised at values."""
        ends = [values.poses(end) for end in self.variables[:, :2].T]
        R, X = (np.concatenate(part) for part in zip(*ends, strict=True))
        own, n = np.arange(len(self)), len(self)
        alone = TakingPart(own, own, own + n, own, self.sigma, self.given_rotation, self.given_offset_m)
        return linearised(alone, R, X, values.vectors(self.variables[:, 2]))


def exposure_factors(block: Block) -> Iterator[ExposureFactors]:
    """Yield the exposures that take part."""
    every = taking_part(block)
    if len(every):
        ends = zip(every.master.tolist(), every.companion.tolist(), every.rig.tolist(), strict=True)
        variables = [[key(POSE, i), key(POSE, j), key(RIG, k)] for i, j, k in ends]
        given = every.given_rotation[every.rig], every.given_offset_m[every.rig]
        yield ExposureFactors(np.array(variables, dtype=np.int64), every.sigma, *given)


def rig_priors(block: Block) -> Iterator[VectorFactors]:
    """Yield what is given of the relative poses that are unknowns: zero change with their standard deviations; nothing
    of what is free."""
    for k in estimated(block).tolist():
        yield from vector_prior(key(RIG, k), np.zeros(6), block.rigs[k].sigma)
