"""Points in an octree as viewers load it: a node holds one point for each cell of a grid over its cube, its children
the rest, so that the upper levels are the cloud thinned evenly. Each point is in one node.

A cloud of any size is placed part by part. Its nodes are cut into branches that fit into memory; the few nodes above
the branches remember which of their cells are taken, and a point goes to the highest one whose cell is free.

A code is the Morton code of a point: its cell among 2^FINE_BITS to a side of the cube, the bits of x, y and z in turn
from the lowest. Cut off to 3 bits a level it is the code of the node at that level.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, Int32Array, IntArray

GRID_BITS = 7
GRID_CELLS = 2**GRID_BITS
"""Of the grid of a node to a side."""

DEEPEST = 12
"""Level below which there are no nodes: those there hold all of their points."""

FINE_BITS = DEEPEST + GRID_BITS

COUNTED = 9
"""Level whose nodes are counted, and where branches begin at the latest."""

BRANCH_POINTS = 1_000_000
"""Of a branch, which is in memory at a time."""

LEAF_POINTS = 50_000
"""A node of so many holds all of its points."""

Node = tuple[int, int]
"""Level and code of a node."""

_SPREADING = (
    (32, 0x001F_0000_0000_FFFF),
    (16, 0x001F_0000_FF00_00FF),
    (8, 0x100F_00F0_0F00_F00F),
    (4, 0x10C3_0C30_C30C_30C3),
    (2, 0x1249_2492_4924_9249),
)


@dataclass(frozen=True)
class Cube:
    """The cube of the root, in steps of the coordinates: that of the extent of the points from their lowest corner,
    as some readers take it for granted. What lies on a face between two nodes is in the upper one, what lies on a face
    of the root within."""

    low: tuple[int, int, int]
    side: int

    @classmethod
    def around(cls, low: IntArray, high: IntArray) -> "Cube":
        """Return the cube of points from their lowest steps (3,) and highest."""
        east, north, up = (int(step) for step in low)
        return cls((east, north, up), max(int((high - low).max()), 1))

    def codes(self, steps: Int32Array) -> IntArray:
        """Return the codes (N,) of points, whose steps (N, 3) lie in the cube."""
        fine = ((steps.astype(np.int64) - np.array(self.low)) << FINE_BITS) // self.side
        x, y, z = (_spread(axis) for axis in np.minimum(fine, 2**FINE_BITS - 1).T)
        return np.asarray(x | y << 1 | z << 2)


def _spread(value: IntArray) -> IntArray:
    """Return numbers of 21 bits with two zeros before each bit."""
    for shift, mask in _SPREADING:
        value = (value | value << shift) & mask
    return value


def place(node: Node) -> tuple[int, int, int]:
    """Return the place of a node among those of its level along x, y and z."""
    level, code = node
    x, y, z = (sum((code >> 3 * bit + axis & 1) << bit for bit in range(level)) for axis in range(3))
    return x, y, z


@dataclass(frozen=True, eq=False)
class Branches:
    """Where the octree is cut."""

    code: IntArray
    """Nodes (V,) of the level COUNTED that hold points, ascending."""
    level: IntArray
    """Level (V,) at which the branch of each begins."""

    def levels(self, code: IntArray) -> IntArray:
        """Return the levels (N,) of the branches of points with these codes."""
        return self.level[np.searchsorted(self.code, code >> 3 * (FINE_BITS - COUNTED))]


def branches_of(parts: Iterable[IntArray], most: int = BRANCH_POINTS) -> Branches:
    """Return where the octree of points, whose codes (N,) come in parts, is cut: as high as no branch has more than
    ``most`` points, but at the level COUNTED at the latest."""
    code, count = np.zeros(0, np.int64), np.zeros(0, np.int64)
    for part in parts:
        new, times = np.unique(part >> 3 * (FINE_BITS - COUNTED), return_counts=True)
        code, at = np.unique(np.concatenate([code, new]), return_inverse=True)
        count = np.bincount(at, np.concatenate([count, times]), len(code)).astype(np.int64)
    level = np.full(len(code), COUNTED)
    for depth in reversed(range(COUNTED)):
        _, at = np.unique(code >> 3 * (COUNTED - depth), return_inverse=True)
        level[np.bincount(at, count)[at] <= most] = depth
    return Branches(code, level)


def placed(code: IntArray, branches: Branches, taken: dict[Node, BoolArray]) -> IntArray:
    """Return the levels (N,) of the nodes that the next points of a cloud, with their codes (N,), go to: the highest
    above their branch whose cell is free, else the branch. ``taken`` are the cells of these nodes that have a point;
    those of the points are added."""
    levels = branches.levels(code)
    deepest, waiting = int(levels.max(initial=0)), np.arange(len(code))
    for depth in range(deepest):
        waiting = waiting[levels[waiting] > depth]
        cell = code[waiting] >> 3 * (DEEPEST - depth)
        _, first = np.unique(cell, return_index=True)
        node = cell[first] >> 3 * GRID_BITS
        for one, of_node in zip(*_groups(node, first), strict=True):
            cells = taken.setdefault((depth, one), np.zeros(GRID_CELLS**3, dtype=np.bool_))
            within = cell[of_node] & GRID_CELLS**3 - 1
            free = ~cells[within]
            cells[within] = True
            levels[waiting[of_node[free]]] = depth
    return levels


def nodes_of(code: IntArray, level: int, leaf: int = LEAF_POINTS) -> Iterator[tuple[Node, IntArray]]:
    """Yield the nodes of a branch, which begins at a level, level by level, and the indices, ascending, of the points
    of each; the codes of all are (N,). A node of ``leaf`` points at most has no children."""
    waiting = np.argsort(code, kind="stable")
    for depth in range(level, DEEPEST + 1):
        cell = code[waiting] >> 3 * (DEEPEST - depth)
        node = cell >> 3 * GRID_BITS
        _, at, count = np.unique(node, return_inverse=True, return_counts=True)
        here = (count[at] <= leaf) | (depth == DEEPEST) | (np.diff(cell, prepend=-1) != 0)
        for one, of_node in zip(*_groups(node[here], waiting[here]), strict=True):
            yield (depth, one), np.sort(of_node)
        waiting = waiting[~here]


def grouped_by_node(code: IntArray, levels: IntArray) -> Iterator[tuple[Node, IntArray]]:
    """Yield the nodes of points, with their codes and levels (N,), and the indices of each one's points, ascending."""
    for depth in np.unique(levels).tolist():
        of_level = np.flatnonzero(levels == depth)
        node = code[of_level] >> 3 * (FINE_BITS - depth)
        order = np.argsort(node, kind="stable")
        for one, of_node in zip(*_groups(node[order], of_level[order]), strict=True):
            yield (depth, one), of_node


def _groups(ascending: IntArray, values: IntArray) -> tuple[list[int], list[IntArray]]:
    """Return the different numbers of an array (N,) and of each the values (N,) that stand beside it."""
    begin = np.flatnonzero(np.diff(ascending, prepend=-1))
    return ascending[begin].tolist(), np.split(values, begin[1:]) if len(begin) else []
