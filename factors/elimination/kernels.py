"""Compiled loops over the rays of points: linearisation, elimination, substitution.

Work rows: a ray has two rows of J, each with its Jacobian on the pose (0–5) and the point (6–8), its residual (9), Z
(10–12) and its Jacobian on the free parameters of its camera, the coefficients of its lens field last (13 on), all
multiplied by the root of the ray's weight.
V holds a point's normal matrix (0–8) and right-hand side (9–11), M the elements 00 10 11 20 21 22 of L⁻¹, where L Lᵀ is
the damped V.

A photograph's share of the reduced system, in the flat Q: its diagonal block (0–35), that block's diagonal before the
elimination (36–41), the right-hand side (42–47), then six for every border column. Parameters have their units
(cameras, 12 + K) beside them, 0 for one that is fixed; the numbers of the free ones come as Layout.free_of,
measurements as u, v and 1 / sigma, and where marks have covariances of their own how their rows are mixed.

A ray from behind its camera costs what a residual of BEHIND_PX would, and pulls at nothing.

``bare`` are the measurements less the lens fields of a state, ``measured`` itself where no camera has one: a branch in
these loops would slow blocks without by 5 %, and change which products are fused, and with them the last digits.

Small arrays are read into scalars before anything is written, so that nothing need be read again, and addresses into
large ones are unsigned, so that none is tested for being negative. What runs once per ray makes no arrays and is
compiled without numba's reference counts (``_nrt``): those of OrientedCameras would cost 10 ns.
"""

import numpy as np

from photogram.arrays import FloatArray, Index, IntArray
from photogram.compilation import njit
from photogram.projection import (
    PROJECTIVE,
    READOUT,
    Lens,
    OrientedCameras,
    distorted,
    drift_at_row,
    fill_field_slopes,
    fill_parameter_slopes,
    in_camera,
    in_camera_at_row,
    lens_of,
    misfit,
    pixel_slopes,
    slopes_in_camera,
    slopes_in_world,
    slopes_of_pose,
    stretch_of,
)

BEHIND_PX = 1e4  # no residual within a photograph is as large
SETTLING = 5  # iterations at most
CALIBRATION = 13  # first column of a work row that belongs to free parameters

Six = tuple[float, float, float, float, float, float]


@njit(cache=True, nogil=True, error_model="numpy")
def robust(square: float, loss: int, threshold: float) -> tuple[float, float, float]:
    """Cost ρ, weight ρ' and radial curvature 1 + 2 s ρ''/ρ' of a squared whitened norm s, as loss.robust_terms."""
    if loss == 1 and square > threshold * threshold:
        norm = np.sqrt(square)
        return 2.0 * threshold * norm - threshold * threshold, threshold / norm, 0.0
    if loss == 2:
        ratio = square / (threshold * threshold)
        return threshold * threshold * np.log1p(ratio), 1.0 / (1.0 + ratio), (1.0 - ratio) / (1.0 + ratio)
    return square, 1.0, 1.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def fill_free_slopes(
    q: Lens, c: Index, unit: FloatArray, weight: float, x: float, y: float, xd: float, yd: float, J: FloatArray,
    row: int,
) -> None:  # fmt: skip
    """Fill a ray's derivatives by the free parameters of camera ``c``."""
    fill_parameter_slopes(q, lens_of(unit, np.uint64(c)), weight, x, y, xd, yd, J, row, CALIBRATION)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def linearise_point(
    begin: int, end: int, photograph: IntArray, measured: FloatArray, bare: FloatArray, cameras: OrientedCameras,
    unit: FloatArray, X: FloatArray, number: int, free_of: IntArray, loss: int, threshold: float, least: float,
    J: FloatArray, V: FloatArray,
) -> int:  # fmt: skip
    """Fill the work rows of a point's rays, and add to V: its normal matrix 0–8 and right-hand side 9–11.

    Returns how many come from behind their camera. The derivatives are multiplied by √ρ' (I − (1 − √c) n nᵀ), n the
    direction of the residual and c its radial curvature, which is at least ``least``
    (photogram.factors.elimination.loss).
    """
    behind = 0
    v00, v10, v11, v20, v21, v22 = V[0], V[3], V[4], V[6], V[7], V[8]
    b0, b1, b2 = V[9], V[10], V[11]
    for i in range(begin, end):
        o, p = 2 * (i - begin), np.uint64(photograph[i])
        c = np.uint64(cameras.camera[p])
        model, q, moving = cameras.model[c], lens_of(cameras.parameters, c), unit[c, READOUT]
        px, py, pz = in_camera(cameras, p, X[number, 0], X[number, 1], X[number, 2])
        m0, m1, m2 = 0.0, 0.0, 0.0
        if moving > 0.0 or q[READOUT] != 0.0:
            m0, m1, m2 = drift_at_row(cameras, p, cameras.size_px[c, 1], measured[i, 1])
            px, py, pz = px + q[READOUT] * m0, py + q[READOUT] * m1, pz + q[READOUT] * m2
        if not pz > 0.0 and (model != PROJECTIVE or pz == 0.0):
            J[o], J[o + 1] = 0.0, 0.0
            behind += 1
            continue
        near, bend, away = stretch_of(model, px, py, pz)
        x, y = px * near, py * near
        xd, yd, xx, xy, yy = distorted(q, x, y)
        du, dv = misfit(q, xd, yd, bare[i, 0], bare[i, 1])
        s = measured[i, 2]
        r0, r1 = s * du, s * dv
        _, weight, curvature = robust(r0 * r0 + r1 * r1, loss, threshold)
        along, n0, n1 = 0.0, 0.0, 0.0
        if weight != 1.0:
            root, norm, rest = np.sqrt(weight), np.sqrt(r0 * r0 + r1 * r1), np.sqrt(max(curvature, least))
            along, n0, n1 = 1.0 - rest, r0 / norm, r1 / norm
            s, r0, r1 = s * root, r0 * root / rest, r1 * root / rest
        g0, g1, h0, h1 = pixel_slopes(q, s, xx, xy, yy)
        if along != 0.0:
            t0, t1 = along * (n0 * g0 + n1 * h0), along * (n0 * g1 + n1 * h1)
            g0, g1, h0, h1 = g0 - n0 * t0, g1 - n0 * t1, h0 - n1 * t0, h1 - n1 * t1
        g0, g1, g2 = slopes_in_camera(g0, g1, px, py, near, bend, away)
        h0, h1, h2 = slopes_in_camera(h0, h1, px, py, near, bend, away)
        u0, u1, u2 = slopes_in_world(cameras, p, g0, g1, g2)
        w0, w1, w2 = slopes_in_world(cameras, p, h0, h1, h2)
        J[o, 0], J[o, 1], J[o, 2], J[o, 3], J[o, 4], J[o, 5] = slopes_of_pose(g0, g1, g2, px, py, pz)
        d = o + 1
        J[d, 0], J[d, 1], J[d, 2], J[d, 3], J[d, 4], J[d, 5] = slopes_of_pose(h0, h1, h2, px, py, pz)
        J[o, 6], J[o, 7], J[o, 8], J[o, 9] = u0, u1, u2, r0
        J[d, 6], J[d, 7], J[d, 8], J[d, 9] = w0, w1, w2, r1
        v00 += u0 * u0 + w0 * w0
        v10 += u1 * u0 + w1 * w0
        v11 += u1 * u1 + w1 * w1
        v20 += u2 * u0 + w2 * w0
        v21 += u2 * u1 + w2 * w1
        v22 += u2 * u2 + w2 * w2
        b0 -= u0 * r0 + w0 * r1
        b1 -= u1 * r0 + w1 * r1
        b2 -= u2 * r0 + w2 * r1
        if free_of[c, 1]:
            fill_free_slopes(q, c, unit, s, x, y, xd, yd, J, o)
            lens = free_of[c, 1] - free_of[c, 2]
            if free_of[c, 2]:
                fill_field_slopes(
                    cameras, c, measured[i, 0], measured[i, 1], s, free_of[c, 2], J, o, CALIBRATION + lens
                )
            if along != 0.0:
                for k in range(CALIBRATION, CALIBRATION + free_of[c, 1]):
                    t0 = along * (n0 * J[o, k] + n1 * J[o + 1, k])
                    J[o, k] -= n0 * t0
                    J[o + 1, k] -= n1 * t0
            if moving > 0.0:
                last = np.uint64(CALIBRATION + lens - 1)
                J[o, last], J[d, last] = (
                    moving * (g0 * m0 + g1 * m1 + g2 * m2),
                    moving * (h0 * m0 + h1 * m1 + h2 * m2),
                )
    V[0], V[1], V[2], V[3], V[4], V[5], V[6], V[7], V[8] = v00, v10, v20, v10, v11, v21, v20, v21, v22
    V[9], V[10], V[11] = b0, b1, b2
    return behind


@njit(cache=True, nogil=True, error_model="numpy")
def mix_rows(begin: int, end: int, mixing: FloatArray, prior: FloatArray, J: FloatArray, V: FloatArray) -> None:
    """Whiten the work rows of marks whose u and v have a covariance, as ``Observations.mix``, and fill V from them and
    what is known of their point, ``prior`` (12,)."""
    V[:] = prior
    for i in range(begin, end):
        o = 2 * (i - begin)
        d = o + 1
        for k in range(J.shape[1]):
            J[d, k] = mixing[i, 0] * J[d, k] + mixing[i, 1] * J[o, k]
        for row in (o, d):
            for a in range(3):
                V[9 + a] -= J[row, 6 + a] * J[row, 9]
                for b in range(3):
                    V[3 * a + b] += J[row, 6 + a] * J[row, 6 + b]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def point_cost(
    begin: int, end: int, photograph: IntArray, measured: FloatArray, bare: FloatArray, cameras: OrientedCameras,
    X: FloatArray, number: int, loss: int, threshold: float,
) -> tuple[float, int]:  # fmt: skip
    """Return the cost of a point's rays, and how many come from behind their camera or are beyond the threshold."""
    cost, bad = 0.0, 0
    for i in range(begin, end):
        p = np.uint64(photograph[i])
        c = np.uint64(cameras.camera[p])
        model, q = cameras.model[c], lens_of(cameras.parameters, c)
        px, py, pz = in_camera_at_row(
            cameras, p, q[READOUT], cameras.size_px[c, 1], measured[i, 1], X[number, 0], X[number, 1], X[number, 2]
        )
        if not pz > 0.0 and (model != PROJECTIVE or pz == 0.0):
            cost += robust((measured[i, 2] * BEHIND_PX) ** 2, loss, threshold)[0]
            bad += 1
            continue
        near, _, _ = stretch_of(model, px, py, pz)
        xd, yd, _, _, _ = distorted(q, px * near, py * near)
        du, dv = misfit(q, xd, yd, bare[i, 0], bare[i, 1])
        r0, r1 = measured[i, 2] * du, measured[i, 2] * dv
        square = r0 * r0 + r1 * r1
        cost += robust(square, loss, threshold)[0]
        bad += loss != 0 and square > threshold * threshold
    return 0.5 * cost, bad


@njit(cache=True, nogil=True, error_model="numpy")
def inverse_factor(V: FloatArray, damping: float, M: FloatArray) -> bool:
    """The inverse of the lower Cholesky factor of V, its diagonal scaled by 1 + damping, as its elements 00 10 11 20 21
    22 in M; False when V is singular."""
    grown = 1.0 + damping
    a, d, f = grown * V[0], grown * V[4], grown * V[8]
    if not (a > 0.0 and d > 0.0 and f > 0.0):
        return False
    l00 = np.sqrt(a)
    l10, l20 = V[3] / l00, V[6] / l00
    second = d - l10 * l10
    if not second > 0.0:
        return False
    l11 = np.sqrt(second)
    l21 = (V[7] - l20 * l10) / l11
    third = f - l20 * l20 - l21 * l21
    if not second * third > 1e-14 * d * f:
        return False
    l22 = np.sqrt(third)
    M[0], M[2], M[5] = 1.0 / l00, 1.0 / l11, 1.0 / l22
    M[1] = -l10 * M[0] / l11
    M[3], M[4] = -(l20 * M[0] + l21 * M[1]) / l22, -l21 * M[2] / l22
    return True


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def eliminate_coordinates(rows: int, M: FloatArray, J: FloatArray) -> None:
    """Fill Z = B L⁻ᵀ of a point's work rows from their Jacobians B on the point."""
    for o in range(rows):
        u0, u1, u2 = J[o, 6], J[o, 7], J[o, 8]
        J[o, 10], J[o, 11], J[o, 12] = u0 * M[0], u0 * M[1] + u1 * M[2], u0 * M[3] + u1 * M[4] + u2 * M[5]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def add_six(A: FloatArray, at: int, p: Six, m: float, s: Six, n: float) -> None:
    """Add p m + s n to six elements of A from ``at`` on."""
    u = np.uint64(at)
    i1, i2, i3 = u + np.uint64(1), u + np.uint64(2), u + np.uint64(3)
    i4, i5 = u + np.uint64(4), u + np.uint64(5)
    t0, t1, t2 = A[u] + p[0] * m + s[0] * n, A[i1] + p[1] * m + s[1] * n, A[i2] + p[2] * m + s[2] * n
    t3, t4, t5 = A[i3] + p[3] * m + s[3] * n, A[i4] + p[4] * m + s[4] * n, A[i5] + p[5] * m + s[5] * n
    A[u], A[i1], A[i2], A[i3], A[i4], A[i5] = t0, t1, t2, t3, t4, t5


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def subtract_pairs(count: int, place: IntArray, J: FloatArray, A: FloatArray, block_at: IntArray, start: int) -> None:
    """Subtract A_iᵀ Z_i Z_jᵀ A_j of all pairs of a point's rays, in the order of the band, from their blocks of A
    (flat), the first of which is number ``start``."""
    for j in range(count):
        if place[j] < 0:
            continue
        z00, z01, z02, z10, z11, z12 = (
            J[2 * j, 10],
            J[2 * j, 11],
            J[2 * j, 12],
            J[2 * j + 1, 10],
            J[2 * j + 1, 11],
            J[2 * j + 1, 12],
        )
        for i in range(j + 1, count):
            c, d = 2 * i, 2 * i + 1
            k00 = -J[c, 10] * z00 - J[c, 11] * z01 - J[c, 12] * z02
            k01 = -J[c, 10] * z10 - J[c, 11] * z11 - J[c, 12] * z12
            k10 = -J[d, 10] * z00 - J[d, 11] * z01 - J[d, 12] * z02
            k11 = -J[d, 10] * z10 - J[d, 11] * z11 - J[d, 12] * z12
            corner = 36 * (block_at[place[j], place[i] - place[j]] - start)
            p = (J[c, 0], J[c, 1], J[c, 2], J[c, 3], J[c, 4], J[c, 5])
            s = (J[d, 0], J[d, 1], J[d, 2], J[d, 3], J[d, 4], J[d, 5])
            if place[i] != place[j]:
                for b in range(6):
                    m, n = k00 * J[2 * j, b] + k01 * J[2 * j + 1, b], k10 * J[2 * j, b] + k11 * J[2 * j + 1, b]
                    add_six(A, corner + 6 * b, p, m, s, n)
                continue
            for b in range(6):  # twice in one photograph: the block and its transpose, the lower half of each
                m, n = k00 * J[2 * j, b] + k01 * J[2 * j + 1, b], k10 * J[2 * j, b] + k11 * J[2 * j + 1, b]
                for a in range(6):
                    value = J[c, a] * m + J[d, a] * n
                    A[corner + 6 * min(a, b) + max(a, b)] += 2.0 * value if a == b else value


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def add_pose(
    block: int,
    o: int,
    own: int,
    slots: int,
    slot_of: IntArray,
    J: FloatArray,
    y: FloatArray,
    Yc: FloatArray,
    Q: FloatArray,
) -> None:
    """Add a ray's share to the rows of its pose, which begin at ``block`` of the flat Q."""
    z00, z01, z02, z10, z11, z12 = J[o, 10], J[o, 11], J[o, 12], J[o + 1, 10], J[o + 1, 11], J[o + 1, 12]
    k00, k11 = 1.0 - z00 * z00 - z01 * z01 - z02 * z02, 1.0 - z10 * z10 - z11 * z11 - z12 * z12
    k01 = -z00 * z10 - z01 * z11 - z02 * z12
    p = (J[o, 0], J[o, 1], J[o, 2], J[o, 3], J[o, 4], J[o, 5])
    s = (J[o + 1, 0], J[o + 1, 1], J[o + 1, 2], J[o + 1, 3], J[o + 1, 4], J[o + 1, 5])
    for b in range(6):
        m, n = J[o, b], J[o + 1, b]
        add_six(Q, block + 6 * b, p, k00 * m + k01 * n, s, k01 * m + k11 * n)
        Q[block + 36 + b] += m * m + n * n
    e0, e1 = J[o, 9] + z00 * y[0] + z01 * y[1] + z02 * y[2], J[o + 1, 9] + z10 * y[0] + z11 * y[1] + z12 * y[2]
    add_six(Q, block + 42, p, -e0, s, -e1)
    for slot in range(slots):
        start, mine = block + 48 + 6 * slot_of[slot, 0], slot == own
        for t in range(slot_of[slot, 1]):
            y0, y1, y2 = Yc[slot, 0, t], Yc[slot, 1, t], Yc[slot, 2, t]
            m, n = -z00 * y0 - z01 * y1 - z02 * y2, -z10 * y0 - z11 * y1 - z12 * y2
            if mine:
                m += J[o, CALIBRATION + t]
                n += J[o + 1, CALIBRATION + t]
            add_six(Q, start + 6 * t, p, m, s, n)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def add_border(
    count: int, first: int, photograph: IntArray, camera_of: IntArray, free_of: IntArray, J: FloatArray, y: FloatArray,
    slot_of: IntArray, own: IntArray, Yc: FloatArray, H: FloatArray,
) -> int:  # fmt: skip
    """Add a point's share to the border: H holds its matrix, then the undamped diagonal, then the right-hand side.

    Fills Yc (cameras, 3, 12 + K) with the sums of Z_iᵀ C_i over the rays of each camera that moves, ``slot_of`` with
    their first border columns and numbers of columns, ``own`` with each ray's slot, −1 for none; returns the number of
    slots.
    """
    border, slots = H.shape[1], 0
    for o in range(count):
        camera = camera_of[photograph[first + o]]
        own[o], column, size = -1, free_of[camera, 0], free_of[camera, 1]
        if column < 0:
            continue
        slot = 0
        while slot < slots and slot_of[slot, 0] != column:
            slot += 1
        if slot == slots:
            slot_of[slot, 0], slot_of[slot, 1], slots = column, size, slots + 1
            Yc[slot] = 0.0
        own[o], c, d = slot, 2 * o, 2 * o + 1
        for t in range(size):
            m, n = J[c, CALIBRATION + t], J[d, CALIBRATION + t]
            H[border + 1, column + t] -= m * J[c, 9] + n * J[d, 9]
            H[border, column + t] += m * m + n * n
            for k in range(3):
                Yc[slot, k, t] += J[c, 10 + k] * m + J[d, 10 + k] * n
            for s in range(t + 1):
                H[column + t, column + s] += m * J[c, CALIBRATION + s] + n * J[d, CALIBRATION + s]
    for slot in range(slots):
        for a in range(slot_of[slot, 1]):
            row, y0, y1, y2 = slot_of[slot, 0] + a, Yc[slot, 0, a], Yc[slot, 1, a], Yc[slot, 2, a]
            H[border + 1, row] -= y0 * y[0] + y1 * y[1] + y2 * y[2]
            for other in range(slots):
                low = slot_of[other, 0]
                if low > slot_of[slot, 0]:
                    continue
                for t in range(slot_of[other, 1] if other != slot else a + 1):
                    H[row, low + t] -= y0 * Yc[other, 0, t] + y1 * Yc[other, 1, t] + y2 * Yc[other, 2, t]
    return slots


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def accumulate(
    begin: int, end: int, first: IntArray, index: IntArray, photograph: IntArray, measured: FloatArray,
    mixing: FloatArray, bare: FloatArray, cameras: OrientedCameras, unit: FloatArray, X: FloatArray, place_of: IntArray,
    free_of: IntArray, loss: int, threshold: float, least: float, damping: float, prior: FloatArray,
    block_at: IntArray, start: int, A: FloatArray, Q: FloatArray, H: FloatArray,
) -> int:  # fmt: skip
    """Add the points of a range to A, whose first block is number ``start``, Q and H.

    Returns the first point that cannot be eliminated, −1 when all can.
    """
    longest = 1
    for p in range(begin, end):
        longest = max(longest, first[p + 1] - first[p])
    J, V, M, y = np.zeros((2 * longest, CALIBRATION + unit.shape[1])), np.zeros(12), np.zeros(6), np.zeros(3)
    place, own = np.zeros(longest, np.int64), np.zeros(longest, np.int64)
    count = len(cameras.model)
    slot_of, Yc = np.zeros((count, 2), np.int64), np.zeros((count, 3, unit.shape[1]))
    share = 48 + 6 * H.shape[1]
    for p in range(begin, end):
        for k in range(12):
            V[k] = prior[index[p], k] if len(prior) else 0.0
        linearise_point(
            first[p], first[p + 1], photograph, measured, bare, cameras, unit, X, index[p], free_of, loss, threshold,
            least, J, V,
        )  # fmt: skip
        if len(mixing):
            mix_rows(first[p], first[p + 1], mixing, prior[index[p]], J, V)
        if V[0] + V[4] + V[8] == 0.0:  # behind all of its cameras
            continue
        if not inverse_factor(V, damping, M):
            return int(index[p])
        y[0], y[1] = M[0] * V[9], M[1] * V[9] + M[2] * V[10]
        y[2] = M[3] * V[9] + M[4] * V[10] + M[5] * V[11]
        count = first[p + 1] - first[p]
        eliminate_coordinates(2 * count, M, J)
        slots = add_border(count, first[p], photograph, cameras.camera, free_of, J, y, slot_of, own, Yc, H)
        for o in range(count):
            place[o] = place_of[photograph[first[p] + o]]
            if place[o] >= 0:
                add_pose(place[o] * share, 2 * o, own[o], slots, slot_of, J, y, Yc, Q)
        subtract_pairs(count, place, J, A, block_at, start)
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def settle_point(
    begin: int, end: int, photograph: IntArray, measured: FloatArray, bare: FloatArray, cameras: OrientedCameras,
    unit: FloatArray, X: FloatArray, number: int, fixed: IntArray, loss: int, threshold: float, least: float,
    value: float, J: FloatArray, V: FloatArray, M: FloatArray, moved: FloatArray,
) -> float:  # fmt: skip
    """Move a point with mismatches, of the cost ``value``, down its own cost while its cameras rest; returns its cost.

    Begins where the step took it or where it was in X, whichever costs less. Embedded iterations (Jeong et al. 2012):
    what mismatches make of a point is far from linear, and would hold back the step of everything.
    """
    stayed, _ = point_cost(begin, end, photograph, measured, bare, cameras, X, number, loss, threshold)
    if stayed < value:
        moved[number], value = X[number], stayed
    damping = 1e-3
    for _ in range(SETTLING):
        V[:] = 0.0
        linearise_point(
            begin, end, photograph, measured, bare, cameras, unit, moved, number, fixed, loss, threshold, least, J, V
        )
        if not inverse_factor(V, damping, M):
            break
        y0, y1, y2 = M[0] * V[9], M[1] * V[9] + M[2] * V[10], M[3] * V[9] + M[4] * V[10] + M[5] * V[11]
        t0, t1, t2 = M[0] * y0 + M[1] * y1 + M[3] * y2, M[2] * y1 + M[4] * y2, M[5] * y2
        x, y, z = moved[number, 0], moved[number, 1], moved[number, 2]
        before, far = value, 1.0
        while far < 1e6:  # a point whose rays diverge is better off the farther it goes
            moved[number, 0], moved[number, 1], moved[number, 2] = x + far * t0, y + far * t1, z + far * t2
            tried, _ = point_cost(begin, end, photograph, measured, bare, cameras, moved, number, loss, threshold)
            if not tried < value:
                break
            value, far = tried, 2.0 * far
        far *= 0.5
        if far < 1.0:
            moved[number, 0], moved[number, 1], moved[number, 2], damping = x, y, z, 10.0 * damping
            continue
        moved[number, 0], moved[number, 1], moved[number, 2] = x + far * t0, y + far * t1, z + far * t2
        damping *= 0.1
        if before - value < 1e-3 * value:
            break
    return value


@njit(cache=True, nogil=True, error_model="numpy")
def cost_of_points(
    begin: int, end: int, first: IntArray, index: IntArray, photograph: IntArray, measured: FloatArray,
    bare: FloatArray, cameras: OrientedCameras, X: FloatArray, loss: int, threshold: float,
) -> float:  # fmt: skip
    """Return the cost of the points of a range."""
    cost = 0.0
    for p in range(begin, end):
        cost += point_cost(first[p], first[p + 1], photograph, measured, bare, cameras, X, index[p], loss, threshold)[0]
    return cost


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def substitute_points(
    begin: int, end: int, first: IntArray, index: IntArray, photograph: IntArray, measured: FloatArray,
    mixing: FloatArray, bare: FloatArray, cameras: OrientedCameras, unit: FloatArray, X: FloatArray, place_of: IntArray,
    free_of: IntArray, loss: int, threshold: float, least: float, damping: float, prior: FloatArray, step: FloatArray,
    border_step: FloatArray,
    moved: OrientedCameras, moved_bare: FloatArray, bend: FloatArray, moved_X: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """Fill the points moved by their part of the step and by ``bend`` (4, 3), as ``bent`` has it; returns their share
    of the decrease that the linear model predicts, and their cost after the step."""
    longest = 1
    for p in range(begin, end):
        longest = max(longest, first[p + 1] - first[p])
    J, V, M = np.zeros((2 * longest, CALIBRATION + unit.shape[1])), np.zeros(12), np.zeros(6)
    decrease, cost, fixed = 0.0, 0.0, np.zeros_like(free_of)
    for p in range(begin, end):
        number = index[p]
        for k in range(12):
            V[k] = prior[number, k] if len(prior) else 0.0
        linearise_point(
            first[p], first[p + 1], photograph, measured, bare, cameras, unit, X, number, free_of, loss, threshold,
            least, J, V,
        )  # fmt: skip
        if len(mixing):
            mix_rows(first[p], first[p + 1], mixing, prior[number], J, V)
        if not inverse_factor(V, damping, M):  # behind all of its cameras
            M[:] = 0.0
        t0, t1, t2 = V[9], V[10], V[11]
        for i in range(first[p], first[p + 1]):
            c, at, camera = 2 * (i - first[p]), 6 * place_of[photograph[i]], cameras.camera[photograph[i]]
            r0, r1 = 0.0, 0.0
            if at >= 0:
                for a in range(6):
                    r0 += J[c, a] * step[at + a]
                    r1 += J[c + 1, a] * step[at + a]
            column = np.uint64(max(free_of[camera, 0], 0))
            for a in range(free_of[camera, 1]):
                change = border_step[column + np.uint64(a)]
                r0 += J[c, CALIBRATION + a] * change
                r1 += J[c + 1, CALIBRATION + a] * change
            decrease -= 0.5 * (J[c, 9] * r0 + J[c + 1, 9] * r1)
            t0 -= J[c, 6] * r0 + J[c + 1, 6] * r1
            t1 -= J[c, 7] * r0 + J[c + 1, 7] * r1
            t2 -= J[c, 8] * r0 + J[c + 1, 8] * r1
        y0, y1, y2 = M[0] * t0, M[1] * t0 + M[2] * t1, M[3] * t0 + M[4] * t1 + M[5] * t2
        t0, t1, t2 = M[0] * y0 + M[1] * y1 + M[3] * y2, M[2] * y1 + M[4] * y2, M[5] * y2
        decrease += 0.5 * (t0 * (V[9] + damping * V[0] * t0) + t1 * (V[10] + damping * V[4] * t1))
        decrease += 0.5 * t2 * (V[11] + damping * V[8] * t2)
        x, y, z = X[number, 0] - bend[3, 0], X[number, 1] - bend[3, 1], X[number, 2] - bend[3, 2]
        moved_X[number, 0] = X[number, 0] + t0 + bend[0, 0] * x + bend[0, 1] * y + bend[0, 2] * z
        moved_X[number, 1] = X[number, 1] + t1 + bend[1, 0] * x + bend[1, 1] * y + bend[1, 2] * z
        moved_X[number, 2] = X[number, 2] + t2 + bend[2, 0] * x + bend[2, 1] * y + bend[2, 2] * z
        value, bad = point_cost(
            first[p], first[p + 1], photograph, measured, moved_bare, moved, moved_X, number, loss, threshold
        )  # fmt: skip
        if bad > 0 and not len(prior):
            value = settle_point(
                first[p], first[p + 1], photograph, measured, moved_bare, moved, unit, X, number, fixed, loss,
                threshold, least, value, J, V, M, moved_X,
            )  # fmt: skip
        cost += value
    return decrease, cost
