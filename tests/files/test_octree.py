"""The octree of a cloud: every point in one node, within its cube, and upper nodes thinned."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.files.clouds.octree import (
    BRANCH_POINTS,
    DEEPEST,
    FINE_BITS,
    GRID_CELLS,
    LEAF_POINTS,
    Cube,
    Node,
    branches_of,
    grouped_by_node,
    nodes_of,
    place,
    placed,
)


def octree(
    steps: np.ndarray, parts: int, branch: int = BRANCH_POINTS, leaf: int = LEAF_POINTS
) -> tuple[Cube, dict[Node, np.ndarray]]:
    """Return the cube of points and the indices of those of each node, the points given in parts."""
    cube = Cube.around(steps.min(axis=0).astype(np.int64), steps.max(axis=0).astype(np.int64))
    pieces: Sequence[np.ndarray] = np.array_split(np.arange(len(steps)), parts)
    branches, taken = branches_of((cube.codes(steps[piece]) for piece in pieces), branch), dict[Node, np.ndarray]()
    begun = dict[Node, list[np.ndarray]]()
    for piece in pieces:
        code = cube.codes(steps[piece])
        for node, index in grouped_by_node(code, placed(code, branches, taken)):
            begun.setdefault(node, []).append(piece[index])
    nodes = {node: np.concatenate(own) for node, own in begun.items() if node in taken}
    for node, own in begun.items():
        if node not in taken:
            of_branch = np.concatenate(own)
            assert len(of_branch) <= branch or node[0] == 9
            nodes |= {one: of_branch[i] for one, i in nodes_of(cube.codes(steps[of_branch]), node[0], leaf)}
    return cube, nodes


def cells(cube: Cube, steps: np.ndarray, bits: int) -> np.ndarray:
    """Return the cells of points among 2^bits to a side, counted in whole numbers of any size."""
    whole = (steps.astype(object) - np.array(cube.low, dtype=object)) * 2**bits // cube.side
    return np.asarray(np.minimum(whole, 2**bits - 1), np.int64)


@st.composite
def clouds(draw: st.DrawFn) -> np.ndarray:
    """Odd clouds as steps (N, 3): a point, all in one place, flat, on a line, clusters, as far apart as LAZ allows."""
    count, seed = draw(st.integers(1, 400)), draw(st.integers(0, 99))
    wide = [draw(st.sampled_from([0, 1, 7, 300, 50_000, 2**31 - 1])) for _ in range(3)]
    low = [draw(st.integers(-(2**31), 2**31 - 1 - width)) for width in wide]
    steps = np.random.default_rng(seed).integers(low, np.array(low) + np.array(wide) + 1, (count, 3))
    if draw(st.booleans()):
        steps[count // 2 :] = steps[0]
    return steps.astype(np.int32)


@settings(max_examples=150, deadline=None)
@given(clouds(), st.integers(1, 5), st.sampled_from([1, 20, 1000]), st.sampled_from([1, 30]))
def test_each_point_is_in_one_node_and_in_its_cube(steps: np.ndarray, parts: int, branch: int, leaf: int) -> None:
    cube, nodes = octree(steps, parts, branch, leaf)
    found = np.concatenate(list(nodes.values()))
    assert sorted(found.tolist()) == list(range(len(steps)))
    for node, index in nodes.items():
        assert len(index)
        assert (cells(cube, steps[index], node[0]) == place(node)).all()
        level, code = node
        assert level == 0 or (level - 1, code >> 3) in nodes, "a node has its parent"
        has_children = any((level + 1, 8 * code + one) in nodes for one in range(8))
        if level < DEEPEST and (has_children or len(index) > leaf):
            grid = cells(cube, steps[index], level + 7)
            assert len(np.unique(grid, axis=0)) == len(index), "one point in a cell"
    again = octree(steps, 6 - parts, branch, leaf)[1]
    assert {node: index.tolist() for node, index in again.items()} == {n: i.tolist() for n, i in nodes.items()}


def test_codes_take_the_bits_of_the_axes_in_turn() -> None:
    cube = Cube((-5, 10, 0), 2**FINE_BITS)
    steps = np.array([[-5, 10, 0], [-4, 10, 0], [-5, 11, 0], [-5, 10, 1], [-2, 11, 2], [2**FINE_BITS - 5, 10, 0]])
    ones = sum(8**bit for bit in range(FINE_BITS))
    assert cube.codes(steps.astype(np.int32)).tolist() == [0, 1, 2, 4, 1 + 8 + 2 + 32, ones]
    assert place((2, 0b110_001)) == (1, 2, 2)


def test_upper_nodes_are_the_surface_thinned_evenly() -> None:
    side = 1024
    y, x = np.mgrid[0:side, 0:side]
    steps = np.column_stack([x.ravel(), y.ravel(), np.zeros(side * side)]).astype(np.int32)
    _, nodes = octree(steps, 7, 300_000, 50_000)
    root = nodes[0, 0]
    assert len(root) == GRID_CELLS**2
    apart = side / GRID_CELLS
    assert steps[root, 0].max() - steps[root, 0].min() == pytest.approx(side - apart, abs=apart)
    assert {level for level, _ in nodes} == {0, 1, 2, 3}
    assert max(len(index) for index in nodes.values()) <= 50_000
