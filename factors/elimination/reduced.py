"""The reduced system of poses and a border of what is common to many of them, [A B; Bᵀ E]: layout, factor, solution.

The poses' matrix A is a band when photographs are numbered so that those with common points lie close together
(reverse Cuthill–McKee, George & Liu 1981, ch. 4, or simply along the block). The border holds the free
parameters of the calibrations, the GNSS offsets and other common errors, and those ground points that an observation
joins to another variable (a distance between two of them, for one), which hence cannot be eliminated one by one; it is
eliminated last, by its Schur complement E − Bᵀ A⁻¹ B. Blocks of the inverse come from the recursion of Takahashi et al.
(1973), panel by panel.

A is filled as blocks of the photographs that have points in common, one after the other in memory, and becomes a band
to be factored. Element (r, c), r ≥ c, of that lies at ``c · stride + r`` of a flat array. With a stride of kd this is
LAPACK's lower band storage of kd subdiagonals, with a stride of n the lower half of a dense matrix: a band as wide as
half of the system is kept dense.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import blas, lapack
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.compilation import njit
from photogram.factors.elimination.levenberg_marquardt import Singular
from photogram.projection import PARAMETERS

PANEL = 48  # columns of the band worked on together
NONE = np.zeros(0, dtype=np.int64)
COLUMNS_AT_ONCE = 4  # right-hand sides from which they are


class SingularError(Singular):
    """A matrix is not positive definite at ``column`` of the reduced system."""

    def __init__(self, column: int) -> None:
        super().__init__(f"not positive definite at column {column}")
        self.column = column


@dataclass(frozen=True, eq=False)
class Layout:
    """Where variables sit in the reduced system.

    ``place`` (N,) of each photograph in the band, −1 for one that is fixed; ``photograph_at`` its inverse; ``reach``
    how many places apart two photographs with common points may lie; ``camera_column`` (cameras,) first border
    column of a camera, −1 when nothing of it is free; ``unit`` (cameras, 12 + K) units of its parameters, 0 where
    fixed: each of the others has a column, in order; ``offset_column`` first border column of the GNSS offsets;
    ``border`` number of border columns; ``coupled`` (K,) ascending numbers of the control points that have the last 3 K
    of them, because they are not eliminated; ``common`` (E,) numbers of unknowns of the other common errors, whose
    columns stand between the offsets and these; ``rigs`` (K,) ascending numbers of the rigs whose relative poses are
    the last of them. ``block_at`` (free, reach + 1) is the number of the block of a place in the band and that so many
    places after it, −1 where they have no points in common; numbers ascend along the band.
    """

    place: IntArray
    photograph_at: IntArray
    reach: int
    camera_column: IntArray
    unit: FloatArray
    offset_column: int
    border: int
    block_at: IntArray
    coupled: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    common: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    rigs: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def common_column(self) -> int:
        """Return the first border column of the common errors that are no GNSS offsets."""
        return self.ground_column - int(self.common.sum())

    def columns_of_common(self, error: int) -> IntArray:
        """Return the border columns of a common error."""
        first = self.common_column + int(self.common[:error].sum())
        return np.arange(first, first + int(self.common[error]))

    def columns_of_rig(self, rig: int) -> IntArray:
        """Return the border columns of the relative pose of a rig."""
        return self.columns_of_common(len(self.common) - len(self.rigs) + int(np.searchsorted(self.rigs, rig)))

    @property
    def ground_column(self) -> int:
        """Return the first border column of the coupled control points."""
        return self.border - 3 * len(self.coupled)

    @property
    def free(self) -> int:
        """Return the number of photographs in the band."""
        return len(self.photograph_at)

    @property
    def columns(self) -> int:
        """Return the number of unknowns of the poses."""
        return 6 * self.free

    @property
    def dense(self) -> bool:
        """Return whether A is kept as a dense matrix."""
        return 2 * (self.reach + 1) > self.free

    @property
    def stride(self) -> int:
        """Return the distance of two columns of A in memory, less one in a band."""
        return self.columns if self.dense else 6 * self.reach + 5

    @property
    def size(self) -> int:
        """Return the number of elements of the flat matrix of the poses."""
        return self.columns * (self.stride if self.dense else self.stride + 1)

    @property
    def first_block(self) -> IntArray:
        """Return the number (free + 1,) of the first block of each place in the band."""
        return np.concatenate([[0], np.cumsum(np.count_nonzero(self.block_at >= 0, axis=1))])

    def element(self, row: IntArray, column: IntArray) -> IntArray:
        """Return where in the blocks elements of the poses' matrix stand, on or below its diagonal blocks."""
        block = self.block_at[column // 6, row // 6 - column // 6]
        return np.asarray(36 * block + 6 * (column % 6) + row % 6)

    @property
    def free_parameters(self) -> tuple[IntArray, IntArray]:
        """Return camera and parameter of each of the border's first columns, those of the calibrations."""
        camera, parameter = np.nonzero(self.unit > 0)
        return camera.astype(np.int64), parameter.astype(np.int64)

    @property
    def border_unit(self) -> FloatArray:
        """Return the units (border,) of the border: those of the calibrations, and 1 (m, s, rad) for the rest."""
        return np.concatenate([self.unit[self.free_parameters], np.ones(self.border - self.offset_column)])

    @property
    def free_of(self) -> IntArray:
        """Return for compiled loops, by camera (cameras, 3 + 12 + K): its first border column, −1 for none, how many of
        its parameters are free, how many of these are coefficients of its lens field, and which."""
        table = np.zeros((len(self.unit), 3 + self.unit.shape[1]), dtype=np.int64)
        for c, unit in enumerate(self.unit):
            free = np.flatnonzero(unit > 0)
            table[c, :3] = self.camera_column[c], len(free), np.count_nonzero(free >= PARAMETERS)
            table[c, 3 : 3 + len(free)] = free
        return table


@njit(cache=True, nogil=True)
def _neighbours(first: IntArray, photograph: IntArray, number: IntArray, adjacent: BoolArray) -> None:
    for p in range(len(first) - 1):
        for i in range(first[p], first[p + 1]):
            a = number[photograph[i]]
            if a < 0:
                continue
            for j in range(first[p], i):
                b = number[photograph[j]]
                if b >= 0:
                    adjacent[a, b] = True
                    adjacent[b, a] = True


def _order(rows: IntArray, columns: IntArray, position: FloatArray) -> IntArray:
    """Return the order of photographs in which the farthest two with common points, ``rows`` and ``columns``, lie
    closest together: that of reverse Cuthill–McKee, or along one of the two main axes of their ``position`` (n, 3)."""
    n = len(position)
    if not len(rows):
        return np.arange(n)
    graph = csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    orders = [reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)]
    if np.isfinite(position).all():
        centred = position - position.mean(axis=0)
        axes = np.linalg.eigh(centred.T @ centred)[1]
        orders += [np.argsort(centred @ axes[:, k], kind="stable") for k in (2, 1)]

    def reach(order: IntArray) -> int:
        rank = np.argsort(order)
        return int(np.abs(rank[rows] - rank[columns]).max())

    return min(orders, key=reach)


def make_layout(
    points: list[tuple[IntArray, IntArray]],
    fixed: BoolArray,
    position: FloatArray,
    unit: FloatArray,
    offsets: int = 0,
    coupled: IntArray = NONE,
    common: IntArray = NONE,
    rigs: IntArray = NONE,
) -> Layout:
    """Order the photographs that are not ``fixed`` (N,) and lay out the border.

    ``points`` are pairs of the first observation (P + 1,) of each point and the photograph (N,) of each observation;
    ``position`` (N, 3) roughly where photographs are; ``unit`` (cameras, 12 + K) the units of free parameters, 0 where
    fixed; ``offsets`` the number of GNSS offsets; ``coupled`` (K,) the control points, ascending, that are not
    eliminated; ``common`` (E,) the numbers of unknowns of other common errors; ``rigs`` (K,) the numbers of the
    rigs whose relative poses, of six unknowns each, come after them.
    """
    free = np.flatnonzero(~fixed)
    number = np.full(len(fixed), -1, dtype=np.int64)
    number[free] = np.arange(len(free))
    adjacent = np.zeros((len(free), len(free)), dtype=bool)
    for first, photograph in points:
        _neighbours(first, photograph, number, adjacent)
    rows, columns = np.nonzero(adjacent)
    order = _order(rows, columns, position[free])
    rank = np.empty(len(free), dtype=np.int64)
    rank[order] = np.arange(len(free))
    place = np.full(len(fixed), -1, dtype=np.int64)
    place[free] = rank
    after = rank[rows] - rank[columns]
    reach = int(after.max(initial=0))
    block_at = np.full((len(free), reach + 1), -1, dtype=np.int64)
    block_at[:, 0] = 0  # a photograph may see a point twice
    block_at[rank[columns[after > 0]], after[after > 0]] = 0
    block_at[block_at == 0] = np.arange(np.count_nonzero(block_at == 0))
    size = np.count_nonzero(unit > 0, axis=1)
    column = np.where(size > 0, np.cumsum(size) - size, -1).astype(np.int64)
    offset_column = int(size.sum())
    common = np.concatenate([common, np.full(len(rigs), 6, dtype=np.int64)])
    border = offset_column + 3 * (offsets + len(coupled)) + int(common.sum())
    return Layout(place, free[order], reach, column, unit, offset_column, border, block_at, coupled, common, rigs)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The reduced normal equations of a layout, filled in place.

    ``A`` (blocks, 36) blocks of the poses' matrix below its diagonal, column by column, as the layout numbers them, and
    of the diagonal what photographs that see a point twice add. ``Q`` (free, 48 + 6 border) holds for each
    photograph its diagonal block, the diagonal before the elimination of points, the right-hand side and the columns of
    B; ``H`` (border + 2, border) the lower part of the border's matrix, its diagonal before elimination and its
    right-hand side.
    """

    layout: Layout
    A: FloatArray
    Q: FloatArray
    H: FloatArray

    @staticmethod
    def zero(layout: Layout, blocks: int | None = None) -> NormalEquations:
        """Return empty normal equations, with so many ``blocks``, or all."""
        k, blocks = layout.border, int(layout.first_block[-1]) if blocks is None else blocks
        return NormalEquations(
            layout, np.zeros((blocks, 36)), np.zeros((layout.free, 48 + 6 * k)), np.zeros((k + 2, k))
        )

    def part(self, begin: int, end: int) -> NormalEquations:
        """Return empty normal equations with the blocks ``begin`` to ``end`` alone."""
        return NormalEquations.zero(self.layout, end - begin)

    def add(self, part: NormalEquations, begin: int) -> None:
        """Add a part whose blocks start at ``begin``."""
        self.A[begin : begin + len(part.A)] += part.A
        self.Q[...] += part.Q
        self.H[...] += part.H

    @property
    def U(self) -> FloatArray:  # noqa: N802 - the formulas' names
        """Return the diagonal blocks (free, 6, 6) of the poses."""
        return self.Q[:, :36].reshape(-1, 6, 6)

    @property
    def D(self) -> FloatArray:  # noqa: N802 - the formulas' names
        """Return the poses' diagonal (6 free,) before the elimination of points."""
        return self.Q[:, 36:42].reshape(-1)

    @property
    def g(self) -> FloatArray:
        """Return the poses' right-hand side (6 free,)."""
        return self.Q[:, 42:48].reshape(-1)

    @property
    def B(self) -> FloatArray:  # noqa: N802 - the formulas' names
        """Return the block (6 free, border) of poses and border."""
        layout = self.layout
        B = self.Q[:, 48:].reshape(layout.free, layout.border, 6).transpose(0, 2, 1)
        return np.ascontiguousarray(B).reshape(layout.columns, layout.border)

    @property
    def E(self) -> FloatArray:  # noqa: N802 - the formulas' names
        """Return the matrix (border, border) of the border."""
        lower = self.H[:-2]
        return np.tril(lower) + np.tril(lower, -1).T

    @property
    def F(self) -> FloatArray:  # noqa: N802 - the formulas' names
        """Return the diagonal (border,) of the border before the elimination of points."""
        return np.asarray(self.H[-2])

    @property
    def h(self) -> FloatArray:
        """Return the right-hand side (border,) of the border."""
        return np.asarray(self.H[-1])

    def diagonal(self) -> FloatArray:
        """Return the diagonal (6 free + border,) of the reduced system."""
        return np.concatenate([np.einsum("naa->na", self.U).ravel(), np.diag(self.E)])

    def damped_poses(self, damping: float, memory: FloatArray | None = None) -> FloatArray:
        """Return the poses' matrix (flat) with its diagonal raised by ``damping`` times D; in ``memory`` if given."""
        layout = self.layout
        A = np.empty(layout.size) if memory is None else memory
        A[:] = 0.0
        _fill(A, self.A, layout.block_at, self.U, layout.stride)
        A[np.arange(layout.columns) * (layout.stride + 1)] += damping * self.D
        return A

    def damped_border(self, damping: float) -> FloatArray:
        """Return the border's matrix with its diagonal raised by ``damping`` times F."""
        E = self.E
        E[np.diag_indices(len(E))] += damping * self.F
        return E

    def factor(
        self,
        damping: float = 0.0,
        scale: FloatArray | None = None,
        shift: float = 0.0,
        memory: FloatArray | None = None,
    ) -> Factor:
        """Factor the system: its diagonal raised by ``damping`` times D and F; or, with ``scale`` (6 free + border,),
        its rows and columns divided by it; then ``shift`` added to the diagonal. The factor of the poses is made in
        ``memory`` (layout.size,) if given.

        Raises SingularError where it is not positive definite.
        """
        layout, m = self.layout, self.layout.columns
        A = self.damped_poses(damping, memory)
        B = self.B
        E = self.damped_border(damping)
        at = np.arange(m) * (layout.stride + 1)
        if scale is not None:
            scale_matrix(A, scale, layout)
            B /= np.outer(scale[:m], scale[m:])
            E /= np.outer(scale[m:], scale[m:])
        A[at] += shift
        E[np.diag_indices(len(E))] += shift
        return _factor(layout, A, B, E)


@dataclass(frozen=True, eq=False)
class Terms:
    """Information of a linearisation, and half its squared residuals in ``cost``.

    Poses: ``pose`` (free, 6, 6), ``pose_border`` (6 free, border), ``pose_gradient`` (6 free,), in the order of the
    band; ``border`` (border, border), ``border_gradient`` (border,); ``control`` (G, 3, 3), ``control_gradient`` (G,
    3), zero for points of the border. Gradients are right-hand sides, −Jᵀr. Between two poses: ``between`` (E,) at the
    rows and columns ``between_at`` (E, 2) of the poses' matrix, below its diagonal blocks.
    """

    cost: float
    pose: FloatArray
    pose_border: FloatArray
    pose_gradient: FloatArray
    border: FloatArray
    border_gradient: FloatArray
    control: FloatArray
    control_gradient: FloatArray
    between_at: IntArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    between: FloatArray = field(default_factory=lambda: np.zeros(0))

    @staticmethod
    def zero(layout: Layout, controls: int) -> Terms:
        """Return terms that say nothing."""
        n = layout.free
        m = layout.columns
        k = layout.border
        return Terms(
            0.0, np.zeros((n, 6, 6)), np.zeros((m, k)), np.zeros(m), np.zeros((k, k)), np.zeros(k),
            np.zeros((controls, 3, 3)), np.zeros((controls, 3)),
        )  # fmt: skip

    @property
    def control_prior(self) -> FloatArray:
        """Return information and right-hand side (G, 12) of the control points."""
        return np.concatenate([self.control.reshape(-1, 9), self.control_gradient], axis=1)

    def add_to(self, normal: NormalEquations) -> None:
        """Add everything but the control points to the normal equations, in place."""
        layout = normal.layout
        free, border = layout.free, layout.border
        normal.Q[:, :36] += self.pose.reshape(free, 36)
        normal.Q[:, 36:42] += np.einsum("naa->na", self.pose)
        normal.Q[:, 42:48] += self.pose_gradient.reshape(free, 6)
        normal.Q[:, 48:] += self.pose_border.reshape(free, 6, border).transpose(0, 2, 1).reshape(free, 6 * border)
        normal.H[:-2] += self.border
        normal.H[-2] += np.diag(self.border)
        normal.H[-1] += self.border_gradient
        if len(self.between):
            np.add.at(normal.A.reshape(-1), layout.element(*self.between_at.T), self.between)


@njit(cache=True, nogil=True)
def _fill(A: FloatArray, blocks: FloatArray, block_at: IntArray, U: FloatArray, stride: int) -> None:
    for n in range(len(U)):
        for after in range(block_at.shape[1]):
            k = block_at[n, after]
            if k < 0:
                continue
            for c in range(6):
                at = (6 * n + c) * stride + 6 * (n + after)
                for r in range(0 if after else c, 6):
                    A[at + r] = blocks[k, 6 * c + r] if after else blocks[k, 6 * c + r] + U[n, c, r]


def blocks_of(A: FloatArray, layout: Layout) -> FloatArray:
    """Return the blocks (blocks, 36) of a flat matrix, as the layout numbers them; of those on the diagonal the lower
    half alone has a meaning."""
    place, after = np.nonzero(layout.block_at >= 0)
    corner = 6 * (place * layout.stride + place + after)
    inside = (layout.stride * np.arange(6)[:, None] + np.arange(6)).ravel()
    return np.asarray(A[corner[:, None] + inside])


def scale_matrix(A: FloatArray, scale: FloatArray, layout: Layout) -> None:
    """Divide rows and columns of a flat matrix by ``scale`` (at least 6 free,), in place."""
    _scale(A, scale, layout.stride, layout.columns, layout.columns if layout.dense else layout.stride)


@njit(cache=True, nogil=True)
def _scale(A: FloatArray, scale: FloatArray, stride: int, size: int, width: int) -> None:
    for c in range(size):
        for r in range(c, min(size, c + width + 1)):
            A[c * stride + r] /= scale[c] * scale[r]


@dataclass(frozen=True, eq=False)
class Factor:
    """The Cholesky factor L of A (flat, as A), T = A⁻¹ B, and the factor of the border's Schur complement."""

    layout: Layout
    L: FloatArray
    T: FloatArray
    B: FloatArray
    border: FloatArray

    def solve_poses(self, right: FloatArray) -> FloatArray:
        """Return A⁻¹ times ``right`` (6 free, k)."""
        return _solve_poses(self.layout, self.L, right)

    def solve(self, g: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the solution for the right-hand sides g (6 free,) or (6 free, k) and h (border,) or (border, k)."""
        poses = self.solve_poses(g.reshape(len(g), -1)).reshape(g.shape) if len(g) else g
        if not len(h):
            return poses, h
        border, _ = lapack.dpotrs(self.border, h - self.B.T @ poses, lower=1)
        return poses - self.T @ border, border

    def solve_scaled(self, columns: FloatArray, scale: FloatArray) -> FloatArray:
        """Return S⁻¹ times columns (6 free + border, k) of the system S whose rows and columns were divided by
        ``scale`` before it was factored."""
        m, divisor = self.layout.columns, scale[:, None]
        return np.concatenate(self.solve(columns[:m] / divisor[:m], columns[m:] / divisor[m:])) / divisor

    def inverse_within_band(self) -> FloatArray:
        """Return the inverse of A (flat, as A), all of it where A is dense."""
        layout, n = self.layout, self.layout.columns
        if layout.dense:
            inverse, _ = lapack.dpotri(_matrix(layout, self.L), lower=1)
            return np.asarray(inverse.T.reshape(-1))
        kd = layout.stride
        result = np.zeros_like(self.L)
        window = np.zeros((2 * kd + PANEL, 2 * kd + PANEL), order="F")
        at = len(window)
        for start in range((n - 1) // PANEL * PANEL, -1, -PANEL):
            size = min(PANEL, n - start)
            rows = min(n - start, size + kd)
            panel, within = _panel(self.L, start, rows, size, kd)
            panel = np.where(within, panel, 0.0)
            own = panel[:size]
            known = window[at : at + rows - size, at : at + rows - size]
            G = blas.dtrsm(1.0, own, panel[size:], side=1, lower=1)
            below = -(known @ G)
            diagonal, _ = lapack.dpotri(own, lower=1)
            diagonal = np.tril(diagonal) + np.tril(diagonal, -1).T - below.T @ G
            inverse = np.concatenate([diagonal, below])
            target, _ = _panel(result, start, rows, size, kd)
            target[within] = inverse[within]
            if at < size:
                end = len(window)
                window[end - len(known) :, end - len(known) :] = known.copy()
                at = end - len(known)
            at -= size
            window[at : at + rows, at : at + size] = inverse
            window[at : at + size, at : at + rows] = inverse.T
        return result

    def border_covariance(self) -> FloatArray:
        """Return the inverse (border, border) of the border's Schur complement."""
        if not self.layout.border:
            return np.zeros((0, 0))
        inverse, _ = lapack.dpotri(self.border, lower=1)
        return np.ascontiguousarray(np.tril(inverse) + np.tril(inverse, -1).T)


def _matrix(layout: Layout, flat: FloatArray) -> FloatArray:
    """Return the view of a flat matrix that LAPACK works on: (n, n) or (kd + 1, n), in Fortran order."""
    return flat.reshape(layout.columns, -1).T


def _panel(flat: FloatArray, start: int, rows: int, size: int, kd: int) -> tuple[FloatArray, BoolArray]:
    """Return the view (rows, size) of a band from column ``start`` down, and which of its elements are in the band."""
    step = flat.itemsize
    panel = as_strided(flat[start * (kd + 1) :], (rows, size), (step, kd * step))
    below = np.arange(rows)[:, None] - np.arange(size)
    return panel, (below >= 0) & (below <= kd)


def _solve_poses(layout: Layout, L: FloatArray, right: FloatArray) -> FloatArray:
    if not right.size:
        return right.copy()
    if layout.dense:
        solution, _ = lapack.dpotrs(_matrix(layout, L), right, lower=1)
    elif right.shape[1] < COLUMNS_AT_ONCE or layout.stride < PANEL:
        solution, _ = lapack.dpbtrs(_matrix(layout, L), right, lower=1)
    else:
        return _solve_in_panels(layout, L, right)
    return np.ascontiguousarray(solution)


def _solve_in_panels(layout: Layout, L: FloatArray, right: FloatArray) -> FloatArray:
    """Solve for all columns of ``right`` together, where LAPACK would read the band once for each of them."""
    X = np.ascontiguousarray(right).copy()
    n = layout.columns
    kd = layout.stride
    starts = range(0, n, PANEL)

    def panels(start: int) -> tuple[FloatArray, FloatArray, list[tuple[FloatArray, FloatArray]]]:
        size = min(PANEL, n - start)
        rows = min(n - start, size + kd)
        panel, whole = _panel(L, start, rows, size, kd)[0], min(rows, kd + 1)
        last = np.triu(panel[whole:], whole - kd)  # beyond the band there is the next column
        below, end = X[start + size : start + rows], whole - size
        return X[start : start + size], panel[:size], [(panel[size:whole], below[:end]), (last, below[end:])]

    for start in starts:
        own, triangle, parts = panels(start)
        own[...] = blas.dtrsm(1.0, triangle, own, lower=1)
        for part, below in parts:
            below -= part @ own
    for start in reversed(starts):
        own, triangle, parts = panels(start)
        for part, below in parts:
            own -= part.T @ below
        own[...] = blas.dtrsm(1.0, triangle, own, lower=1, trans_a=1)
    return X


def _factor(layout: Layout, A: FloatArray, B: FloatArray, E: FloatArray) -> Factor:
    if layout.free:
        if layout.dense:
            L, info = lapack.dpotrf(_matrix(layout, A), lower=1, overwrite_a=1, clean=0)
        else:
            L, info = lapack.dpbtrf(_matrix(layout, A), lower=1, overwrite_ab=1)
        if info:
            raise SingularError(int(info) - 1)
        A = L.T.reshape(-1)
    T = _solve_poses(layout, A, B)
    border = E - B.T @ T
    if layout.border:
        border, info = lapack.dpotrf(border, lower=1)
        if info:
            raise SingularError(layout.columns + int(info) - 1)
    return Factor(layout, A, T, B, border)
