"""Free networks: a block that nothing places in a world, adjusted on a minimal datum, and its relative precision.

Image points alone leave seven directions open, shifts, turns and the scale, or six with a measured distance. As many
conditions, on the pose of one photograph and on its distance from another, make the system regular and strain nothing:
every residual, redundancy number and test is that of any other choice. Covariances are not. They are brought to the
datum of the object, in which the change of all tie points has no shift, turn and scale in common (inner constraints:
Granshaw 1980; Förstner & Wrobel 2016, sec. 4.5), by the S-transformation (Baarda 1973) with S = I − D Fᵀ,

    S Σ Sᵀ = Σ − D Fᵀ Σ − (D Fᵀ Σ)ᵀ + D (Fᵀ Σ F) Dᵀ,

D the open directions and F the functions that fit them to a change of the tie points by least squares. Points that are
known much worse than most, far behind the object, say nothing of it and have no weight in the fit.
"""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray
from photogram.factors.constraints import is_scaled
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.loss import robust_terms
from photogram.factors.elimination.points import first_observations
from photogram.factors.elimination.reprojection import linearise
from photogram.factors.elimination.state import State
from photogram.factors.functionals import functions_of_tie_points
from photogram.factors.graph import Problem
from photogram.factors.joint_covariance import ground_columns, parts_of, ray_covariances
from photogram.factors.linearised.alike import Factors
from photogram.factors.linearised.poses import DistanceFactors
from photogram.factors.priors import known_place, known_rotation
from photogram.factors.variables import POSE, key
from photogram.measures.open_scale import open_scale
from photogram.measures.rough_place import rough_place
from photogram.survey import Block

OBJECT = 3.0
"""Times the median sigma of the tie points' own rays, beyond which one is no part of the object."""
CONDITION = 1e-3
"""Of the distance between two photographs, and in rad: what the conditions of a minimal datum are weighted by."""


def minimal_datum(block: Block) -> tuple[Factors, ...]:
    """Return the conditions that make the adjustment of a free network regular, at the poses of ``block``, all of them
    oriented: the pose of the photograph in the middle, and its distance from the farthest one where no distance is
    measured. None where the block is not free."""
    if not block.is_free or len(block.poses) < 2:
        return ()
    poses = [pose for pose in block.poses if pose is not None]
    centre = np.array([pose.position_world_m for pose in poses])
    first = int(np.argmin(np.linalg.norm(centre - np.median(centre, axis=0), axis=1)))
    base = centre - centre[first]
    length = np.linalg.norm(base, axis=1)
    last = int(np.argmax(length))
    sigma_m = CONDITION * float(length[last])
    rotation = known_rotation(first, poses[first].rotation_world_from_camera, np.full(3, CONDITION))
    fixed_pose = rotation, known_place(first, centre[first], np.eye(3) / sigma_m)
    if is_scaled(block):
        return fixed_pose
    return *fixed_pose, known_place(last, centre[last], base[last][None] / (length[last] * sigma_m))


def datum_conditions(block: Block) -> tuple[Factors, ...]:
    """Return what makes the datum of a block regular whose measurements do not: the conditions of a free network, and
    what holds a block upright, or at a positive scale, whose positions scatter by more than its photographs stand
    apart."""
    rough, scale = rough_place(block), None if is_scaled(block) else open_scale(block)
    conditions = [*minimal_datum(block)]
    if rough is not None:
        conditions.append(known_rotation(rough.photograph, rough.rotation, rough.sigma_rad))
    if scale is not None:
        ends = np.array([[key(POSE, scale.first), key(POSE, scale.last)]], dtype=np.int64)
        conditions.append(DistanceFactors(ends, np.array([scale.distance_m]), np.array([scale.sigma_m])))
    return tuple(conditions)


@dataclass(frozen=True, eq=False)
class RelativeCovariances:
    """Covariances in the datum of the object, world units: ``poses`` (N, 6, 6) of the poses' tangents, ``tie_point``
    (P, 3, 3), and ``ground`` (3 G, 3 G) of all ground points together, NaN where one has no position."""

    poses: FloatArray
    tie_point: FloatArray
    ground: FloatArray


@dataclass(frozen=True, eq=False)
class _ObjectDatum:
    """The k open parts of the datum: functions Σ aᵀX of all tie points, ``a`` (P, 3, k), about ``centre`` (3,); their
    covariance ``own`` (k, k), and those with poses and border ``with_cameras`` (6 free + border, k)."""

    centre: FloatArray
    a: FloatArray
    own: FloatArray
    with_cameras: FloatArray

    def moved(self, position: FloatArray) -> FloatArray:
        """Return how points (P, 3) go with the open parts (P, 3, k)."""
        return _moved(position - self.centre, len(self.own))

    def transformed(self, covariance: FloatArray, moved: FloatArray, with_parts: FloatArray) -> FloatArray:
        """Return covariances (..., n, n) in the datum, of what moves as ``moved`` (..., n, k) and whose covariances
        with the parts are ``with_parts`` (..., n, k)."""
        cross = np.einsum("...ik,...jk->...ij", moved, with_parts)
        back = np.einsum("...ik,kl,...jl->...ij", moved, self.own, moved)
        return np.asarray(covariance - cross - np.swapaxes(cross, -1, -2) + back)


def _moved(apart: FloatArray, parts: int) -> FloatArray:
    """Return by how much shifts, turns and the scale, the first of so many ``parts``, move points (P, 3, parts)."""
    turns = np.cross(np.eye(3)[None], apart[:, None, :]).transpose(0, 2, 1)
    shift = np.broadcast_to(np.eye(3), turns.shape)
    return np.concatenate([shift, turns, apart[:, :, None]], axis=2)[:, :, :parts]


def _object_datum(problem: Problem, state: State, covariances: Covariances) -> _ObjectDatum:
    """Return the datum of the object."""
    parts = 6 if is_scaled(problem.block) else 7
    spread = np.einsum("pii->p", ray_covariances(problem, state))
    weight = (spread <= OBJECT**2 * np.median(spread)).astype(np.float64)
    centre = weight @ state.tie_point / weight.sum()
    D = weight[:, None, None] * _moved(state.tie_point - centre, parts)
    size = np.sqrt(np.einsum("pik,pik->k", D, D))
    normal = np.einsum("pik,pil->kl", D, D) / np.outer(size, size)
    a = (D / size) @ np.linalg.inv(normal) / size
    of_all = functions_of_tie_points(problem, state, covariances.layout, np.arange(len(a)), a)
    with_cameras = covariances.solve(of_all.columns)
    return _ObjectDatum(centre, a, of_all.columns.T @ with_cameras + of_all.own, with_cameras)


def relative_covariances(
    problem: Problem, state: State, covariances: Covariances, ground_world_m: FloatArray, ground: FloatArray
) -> RelativeCovariances:
    """Return the ``covariances`` of a free network, and the joint one ``ground`` (3 G, 3 G) of its ground points
    at ``ground_world_m`` (G, 3), in the datum of the object. A measured distance keeps the scale. Every tie point needs
    two rays."""
    datum = _object_datum(problem, state, covariances)
    parts = len(datum.own)
    rows = 6 * covariances.layout.place[:, None] + np.arange(6)
    into = state.rotation.transpose(0, 2, 1)
    moved = np.zeros((len(into), 6, parts))
    moved[:, :3, 3:6] = into
    moved[:, 3:] = into @ datum.moved(state.position)
    poses = datum.transformed(covariances.poses, moved, datum.with_cameras[rows])
    with_ties = _with_tie_points(problem, state, covariances, datum)
    tie = datum.transformed(covariances.tie_point, datum.moved(state.tie_point), with_ties)
    known, _, turned = ground_columns(problem, state, covariances, ground_world_m)
    joint = np.full_like(ground, np.nan)
    if len(known):
        at = (3 * known[:, None] + np.arange(3)).ravel()
        of_ground = datum.moved(ground_world_m[known]).reshape(len(at), -1)
        with_ground = -np.einsum("cgi,ck->gik", turned, datum.with_cameras).reshape(len(at), -1)
        joint[np.ix_(at, at)] = datum.transformed(ground[np.ix_(at, at)], of_ground, with_ground)
    return RelativeCovariances(poses, tie, joint)


def _with_tie_points(problem: Problem, state: State, covariances: Covariances, datum: _ObjectDatum) -> FloatArray:
    """Return the covariances (P, 3, k) of tie points with the open parts: V⁻¹ (a − Wᵀ z), z those of the cameras,
    observations with their robust weights."""
    layout, z = covariances.layout, datum.with_cameras
    owner, parameter = layout.free_parameters
    poses = z[: layout.columns].reshape(-1, 6, z.shape[1])[layout.place]
    cameras = np.zeros((*state.parameters.shape, z.shape[1]))
    own = np.arange(len(owner))
    cameras[owner, parameter] = z[layout.columns + own] * layout.border_unit[own, None]
    covariance = np.empty((len(state.tie_point), 3, z.shape[1]))
    for begin, end, part in parts_of(problem.tie, len(state.tie_point)):
        linear = linearise(part, state.cameras, state.tie_point[begin:end])
        _, weight, _ = robust_terms(linear.residual, problem.robust_loss, problem.robust_threshold)
        image = np.einsum("nri,nik->nrk", linear.pose, poses[part.photograph])
        image += np.einsum("nri,nik->nrk", linear.calibration, cameras[linear.camera])
        J = (weight[:, None, None] * linear.point).transpose(0, 2, 1)
        first = first_observations(part.point, end - begin)[:-1]
        V = np.add.reduceat(J @ linear.point, first, axis=0)
        pull = np.add.reduceat(J @ image, first, axis=0)
        covariance[begin:end] = np.linalg.solve(V, datum.a[begin:end] - pull)
    return covariance
