"""Direct orientation: a block started from measured positions and attitudes, and verified by its tie points.

Each tie point starts where its rays pass nearest to each other, weakly constrained to the ground below the photographs,
since rays of unadjusted photographs need not meet. Adjusting all photographs, with a limit that follows the residuals
down, then either makes the tie points agree or shows that the measurements were wrong. The measured positions hold a
block of several strips, so weakly that neighbours stay free of each other's, and thousands keep it from bending.
"""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.sfm.reconstruction import Structure, StructureSettings
from photogram.sfm.similarity import similarity_from_attitudes
from photogram.survey import Block

START_SHARE = 0.1  # of the height above the ground; standard deviation of the measured positions in the start
GROUND_WEIGHT = 0.02  # of a ray; weight of the ground constraint of a tie point at the start
ROUNDS = 8
FEWEST = 3  # photographs of a component
AGREEING_SHARE = 0.6  # of all image points, from which the measured poses are accepted
REGISTERED_SHARE = 0.6  # of the photographs
STRANGER_SHARE = 0.6  # of what the photographs agree on average, below which one belongs elsewhere
NEAR = 2.0  # thresholds, from which median residual on the photographs are adjusted with their calibration
ROUNDS_TO_COME_NEAR = 3
LARGEST_TURN_RAD = float(np.deg2rad(12.0))  # between a measured and an adjusted attitude that agree
ATTITUDE_SHARE = 0.8  # of the photographs, whose attitudes must agree
LARGEST_SHIFT = 0.4  # between measured and adjusted positions, over their spread, on average


def measured(block: Block) -> BoolArray:
    """Return which photographs (N,) carry a GNSS position and an attitude."""
    return np.array(
        [p.gnss_world_m is not None and p.attitude_world_from_camera is not None for p in block.photographs], dtype=bool
    )


def _rays(structure: Structure) -> FloatArray:
    """Return the unit directions (O, 3) in the structure's frame of all observations."""
    ideal = structure.ideal(np.ones(len(structure.good), dtype=bool))
    local = np.column_stack([ideal, np.ones(len(ideal))])
    direction = np.einsum("nij,nj->ni", structure.rotation[structure.tie_points.photograph], local)
    return np.asarray(direction / np.linalg.norm(direction, axis=1, keepdims=True))


def _nearest_points(
    structure: Structure, chosen: BoolArray, direction: FloatArray, ground: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return the points (P, 3) nearest to all chosen rays, and the smallest eigenvalue (P,) of their normal matrices.

    With ``ground`` (P, 3) the points are constrained to it by GROUND_WEIGHT.
    """
    tie = structure.tie_points
    d, point = direction[chosen], tie.point[chosen]
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    pull = np.einsum("nij,nj->ni", across, structure.position[tie.photograph[chosen]])
    A = np.array([[np.bincount(point, across[:, i, j], len(tie)) for j in range(3)] for i in range(3)])
    b = np.array([np.bincount(point, pull[:, i], len(tie)) for i in range(3)])
    A, b = np.moveaxis(A, 2, 0), b.T
    strength = np.linalg.eigvalsh(A)[:, 0]
    if ground is not None:
        A = A + GROUND_WEIGHT * np.eye(3)
        b = b + GROUND_WEIGHT * ground
    usable = (np.bincount(point, minlength=len(tie)) >= 2) & (np.linalg.det(A) > 1e-9)
    result = np.full((len(tie), 3), np.nan)
    result[usable] = np.linalg.solve(A[usable], b[usable, :, None])[:, :, 0]
    return result, strength


def _ground_height(structure: Structure, block: Block, chosen: BoolArray, direction: FloatArray) -> float:
    heights = [
        float(structure.position[i, 2] - p.height_above_ground_m)
        for i, p in enumerate(block.photographs)
        if structure.registered[i] and (p.height_above_ground_m or 0.0) > 0.0
    ]
    if heights:
        return float(np.median(heights))
    points, strength = _nearest_points(structure, chosen, direction, None)
    lowest = structure.position[structure.registered, 2].min()
    firm = (strength > np.sin(np.deg2rad(4.0)) ** 2) & (points[:, 2] < lowest)
    return float(np.median(points[firm, 2])) if firm.any() else float(lowest) - 50.0


def _start_points(structure: Structure, block: Block) -> float:
    """Give every tie point a first position on or near the ground, and return the photographs' median height above
    it."""
    tie = structure.tie_points
    chosen = structure.registered[tie.photograph]
    direction = _rays(structure)
    height = _ground_height(structure, block, chosen, direction)
    centre = structure.position[tie.photograph[chosen]]
    down = np.minimum(direction[chosen, 2], -0.05)
    above = np.maximum(centre[:, 2] - height, 1.0)
    reach = np.minimum(above / -down, 10.0 * above)
    foot = centre + direction[chosen] * reach[:, None]
    count = np.maximum(np.bincount(tie.point[chosen], minlength=len(tie)), 1)
    ground = np.stack([np.bincount(tie.point[chosen], foot[:, k], len(tie)) / count for k in range(3)], axis=1)
    structure.point[:] = _nearest_points(structure, chosen, direction, ground)[0]
    structure.good[:] = False
    return float(np.median(np.maximum(structure.position[structure.registered, 2] - height, 1.0)))


def _agreeing_shares(structure: Structure) -> FloatArray:
    """Return the share (N,) of each photograph's image points that agree, 0 without any."""
    everything = np.bincount(structure.tie_points.photograph, minlength=len(structure.camera_of))
    return np.asarray(structure.agreeing / np.maximum(everything, 1))


def direct_structures(block: Block, settings: StructureSettings) -> list[Structure]:
    """Return the components that measured poses lead to, the largest first; none where tie points do not confirm them.

    The frame stays near the world frame; photographs that do not agree with the others are in none.
    """
    whole = _confirmed_structure(block, settings)
    if whole is None:
        return []
    piece, structures = _pieces(whole), []
    for number in np.argsort(-np.bincount(piece[whole.registered]), kind="stable").tolist():
        own = whole.registered & (piece == number)
        if own.sum() < FEWEST:
            continue
        structure = whole.copy()
        structure.withdraw(structure.registered & ~own)
        structures.append(structure)
    return structures


def _confirmed_structure(block: Block, settings: StructureSettings) -> Structure | None:
    camera_of = block.camera_of
    structure = Structure.empty(block.tie_points, block.cameras, camera_of, settings)
    usable = measured(block)
    usable &= np.bincount(block.tie_points.photograph, minlength=len(usable)) >= settings.minimum_points
    if usable.sum() < FEWEST:
        return None
    for i in np.flatnonzero(usable).tolist():
        photograph = block.photographs[i]
        structure.rotation[i] = photograph.attitude_world_from_camera
        structure.position[i] = photograph.gnss_world_m
    structure.registered[:] = usable
    measured_m = structure.position.copy()
    sigma_m = max(START_SHARE * _start_points(structure, block), _stated_sigma_m(block, usable))
    if _spread_across_m(measured_m[usable]) < sigma_m:
        sigma_m = np.inf  # a single strip would roll after the errors of its positions
    limit = np.inf
    for number in range(ROUNDS):
        structure.judge(limit)
        if number > 0:
            _withdraw_strangers(structure)
        if structure.good.sum() < AGREEING_SHARE / 2 * len(structure.good):
            return None
        middle = float(np.median(structure.residual_px(structure.good)))
        near = middle < NEAR * settings.threshold_px
        if number >= ROUNDS_TO_COME_NEAR and not near:
            return None
        # a calibration would take up what are errors of the measured poses
        structure.adjust(
            iterations=8, tolerance=1e-2, huber_px=max(2.0, middle), calibrate=near, loss="cauchy",
            position=measured_m, position_sigma=sigma_m,
        )  # fmt: skip
        last = limit <= settings.threshold_px
        middle = float(np.median(structure.residual_px(structure.good)))
        limit = max(settings.threshold_px, 5.0 * middle)
        if last:
            break
    structure.judge()
    structure.intersect()
    share = _agreeing_shares(structure)
    enough = structure.agreeing >= settings.minimum_points
    confirmed = structure.registered & (share >= settings.minimum_share) & enough
    structure.withdraw(structure.registered & ~confirmed)
    piece = _pieces(structure)
    confirmed &= np.bincount(piece[confirmed], minlength=len(confirmed))[piece] >= FEWEST
    structure.withdraw(structure.registered & ~confirmed)
    theirs = confirmed[block.tie_points.photograph]
    if (
        confirmed.sum() < max(FEWEST, REGISTERED_SHARE * usable.sum())
        or structure.good.sum() < AGREEING_SHARE * theirs.sum()
    ):
        return None
    turned = np.mean(_turns_rad(structure, block) < LARGEST_TURN_RAD)
    return structure if turned >= ATTITUDE_SHARE and _shift(structure, block) < LARGEST_SHIFT else None


def _stated_sigma_m(block: Block, usable: BoolArray) -> float:
    """Return the median of the largest standard deviations that the positions state, m."""
    stated = [block.photographs[i].gnss_sigma_m for i in np.flatnonzero(usable).tolist()]
    return float(np.median([sigma.max() for sigma in stated if sigma is not None]))


def _spread_across_m(position: FloatArray) -> float:
    """Return the standard deviation of positions (N, 3) across their longest direction, m."""
    return float(np.linalg.svd(position - position.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(position)))


def _withdraw_strangers(structure: Structure) -> None:
    """Withdraw photographs that agree far less than most do, before they bend the others."""
    share = _agreeing_shares(structure)
    structure.withdraw(structure.registered & (share < STRANGER_SHARE * np.median(share[structure.registered])))


def _pieces(structure: Structure) -> IntArray:
    """Return the number (N,) of the piece that tie points hold together, of each photograph.

    Photographs of another site agree with each other and with their own measured poses.
    """
    tie, good = structure.tie_points, structure.good
    shape = (len(structure.camera_of), len(tie))
    seen = csr_matrix((np.ones(int(good.sum()), dtype=np.int32), (tie.photograph[good], tie.point[good])), shape=shape)
    joined = (seen @ seen.T) >= structure.settings.minimum_points
    return np.asarray(connected_components(joined, directed=False)[1], dtype=np.int64)


def _shift(structure: Structure, block: Block) -> float:
    """Return the median distance between measured and adjusted positions, over the spread of the measured ones.

    What image points agree with can still be folded or torn where they are few; measured positions show that.
    """
    index = np.flatnonzero(structure.registered)
    target = np.array([block.photographs[i].gnss_world_m for i in index])
    attitude = np.array([block.photographs[i].attitude_world_from_camera for i in index])
    fit = similarity_from_attitudes(structure.position[index], structure.rotation[index], target, attitude)
    spread = float(np.median(np.linalg.norm(target - np.median(target, axis=0), axis=1)))
    moved = float(np.median(np.linalg.norm(fit.points(structure.position[index]) - target, axis=1)))
    return moved / spread if spread > 0 else np.inf


def _turns_rad(structure: Structure, block: Block) -> FloatArray:
    """Return the angles (K,) between measured and adjusted attitudes of the registered photographs."""
    index = np.flatnonzero(structure.registered)
    wanted = np.array([block.photographs[i].attitude_world_from_camera for i in index])
    turn = wanted @ np.swapaxes(structure.rotation[index], 1, 2)
    return np.asarray(np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0)))
