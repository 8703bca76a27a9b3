"""Dataclasses come back from npz bit for bit, whatever they are made of; what is damaged is refused by name."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path, PurePosixPath
from typing import Any, Literal, TypeVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from makers import assert_same
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray
from photogram.errors import WorkspaceError
from photogram.files.npz_json import read_arrays, write_arrays
from photogram.files.records import read_record, write_record


class Colour(Enum):
    RED = 1
    GREEN = "g"


@dataclass(frozen=True, eq=False)
class Leaf:
    values: FloatArray
    kind: Literal["pine", "oak"]
    size: float | None
    marks: IntArray | None
    heights: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Branch:
    leaf: Leaf | None
    leaves: tuple[Leaf | None, ...]
    pair: tuple[int, str]
    flags: BoolArray
    sizes: dict[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Tree:
    branch: Branch
    branches: tuple[Branch, ...]
    colour: Colour
    colours: dict[Colour, int | None]
    path: PurePosixPath | None
    time: datetime
    names: NDArray[np.str_]
    any_array: NDArray[Any]
    bytes_: ByteArray
    alive: bool
    pairs: tuple[tuple[str, str], ...]
    rows: tuple[tuple[IntArray, ...] | None, ...]
    made: int = field(init=False, default=3)


def arrays_of(dtype: Any, least: int = 0) -> st.SearchStrategy[Any]:
    return hnp.arrays(dtype, hnp.array_shapes(min_dims=least, max_dims=3, min_side=0, max_side=3))


TEXTS = st.text(max_size=5).filter(lambda text: not text.endswith("\0"))
INTEGERS = st.integers(-(2**63), 2**63 - 1)
LEAVES = st.builds(
    Leaf,
    arrays_of(np.float64),
    st.sampled_from(["pine", "oak"]),
    st.none() | st.floats(),
    st.none() | arrays_of(np.int64),
    st.lists(st.floats(), max_size=3).map(tuple),
)
BRANCHES = st.builds(
    Branch,
    st.none() | LEAVES,
    st.lists(st.none() | LEAVES, max_size=3).map(tuple),
    st.tuples(INTEGERS, TEXTS),
    arrays_of(np.bool_),
    st.dictionaries(TEXTS, arrays_of(np.float64), max_size=2),
)
TREES = st.builds(
    Tree,
    BRANCHES,
    st.lists(BRANCHES, max_size=2).map(tuple),
    st.sampled_from(Colour),
    st.dictionaries(st.sampled_from(Colour), st.none() | INTEGERS),
    st.none() | st.sampled_from(["a", "b/c", "/d"]).map(PurePosixPath),
    st.datetimes() | st.datetimes(timezones=st.just(UTC)),
    st.lists(TEXTS, max_size=3).map(lambda texts: np.array(texts, dtype=np.str_)),
    arrays_of(np.float32) | arrays_of(np.uint16) | arrays_of(np.bool_),
    arrays_of(np.uint8),
    st.booleans(),
    st.lists(st.tuples(TEXTS, TEXTS), max_size=3).map(tuple),
    st.lists(st.none() | st.lists(arrays_of(np.int64), max_size=2).map(tuple), max_size=2).map(tuple),
)


@settings(max_examples=60, deadline=None)
@given(TREES)
def test_whatever_it_is_made_of_a_record_comes_back(tree: Tree) -> None:
    with tempfile.TemporaryDirectory() as folder:
        one, two = Path(folder, "one.npz"), Path(folder, "two.npz")
        write_record(one, tree)
        back = read_record(one, Tree)
        assert_same(back, tree)
        write_record(two, back)
        assert one.read_bytes() == two.read_bytes()


EXAMPLE = Branch(
    None,
    (Leaf(np.zeros((2, 3)), "oak", 1.5, None, (1.0, 2.0)), None, Leaf(np.ones(4), "pine", None, np.arange(3))),
    (7, "seven"),
    np.array([True, False]),
    {"a": np.zeros(2), "b": np.ones(2)},
)


ScalarT = TypeVar("ScalarT", bound=np.generic)
Aliased = TypeAliasType("Aliased", np.ndarray[tuple[Any, ...], np.dtype[ScalarT]], type_params=(ScalarT,))
"""What NumPy's NDArray is from version 2.5 on."""


@dataclass(frozen=True, eq=False)
class OfAliases:
    values: Aliased[np.float64]
    marks: Aliased[np.int64] | None
    any_array: Aliased[Any]
    several: tuple[Aliased[np.float64], ...] = ()


def test_an_alias_of_arrays_is_what_it_stands_for(tmp_path: Path) -> None:
    record = OfAliases(np.ones((2, 3)), np.arange(4), np.array(["a"]), (np.zeros(2), np.zeros(3)))
    write_record(tmp_path / "a.npz", record)
    assert_same(read_record(tmp_path / "a.npz", OfAliases), record)
    with pytest.raises(TypeError):
        write_record(tmp_path / "a.npz", OfAliases(np.array(["no number"]), None, np.zeros(1)))


def test_entries_are_called_as_the_fields(tmp_path: Path) -> None:
    write_record(tmp_path / "a.npz", EXAMPLE)
    arrays = read_arrays(tmp_path / "a.npz")
    assert arrays["leaves-known"].tolist() == [True, False, True]
    assert arrays["leaves.kind"].tolist() == ["oak", "pine"]
    assert arrays["leaves.size"].tolist() == [1.5]
    assert arrays["leaves.values-shape-count"].tolist() == [2, 1]
    assert arrays["sizes.1"].shape == (2, 2)
    assert arrays["pair.0"].item() == 7


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_flipped_bit_is_refused_by_name_or_changes_nothing(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.npz")
        write_record(path, EXAMPLE)
        content = bytearray(path.read_bytes())
        content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
        path.write_bytes(content)
        try:
            found = read_record(path, Branch)
        except WorkspaceError:
            with pytest.raises(WorkspaceError, match=r"a\.npz: cannot be read \(.*\): delete it and run again"):
                read_record(path, Branch)
        else:
            assert_same(found, EXAMPLE)


DAMAGE: dict[str, tuple[str, Callable[[dict[str, NDArray[Any]]], object]]] = {
    "missing": (r"flags is damaged: it is missing", lambda a: a.pop("flags")),
    "more": (r"other is damaged: nothing of this name", lambda a: a.update(other=np.zeros(1))),
    "type": (r"flags is damaged: it is an array \(2,\) of int64", lambda a: a.update(flags=np.arange(2))),
    "axes": (r"pair\.0 is damaged: it is an array \(1,\)", lambda a: a.update({"pair.0": np.arange(1)})),
    "word": (r"leaves\.kind is damaged: 'elm' is not", lambda a: a.update({"leaves.kind": np.array(["elm", "oak"])})),
    "length": (r"leaves is damaged: its columns", lambda a: a.update({"leaves.kind": np.array(["oak"])})),
    "known": (r"leaves is damaged: it has 2 values", lambda a: a.update({"leaves-known": np.array([True])})),
    "count": (
        r"leaves\.heights is damaged: it has 2 values for rows of 3",
        lambda a: a.update({"leaves.heights-count": np.array([4, -1])}),
    ),
    "shape": (
        r"leaves\.values is damaged",
        lambda a: a.update({"leaves.values-shape-items": np.array([-2, -3, 4])}),
    ),
    "number": (r"sizes\.1 is damaged: it is a single number", lambda a: a.update({"sizes.1": np.array(1.0)})),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_does_not_fit_is_refused_with_its_place(tmp_path: Path, damage: str) -> None:
    words, change = DAMAGE[damage]
    write_record(tmp_path / "a.npz", EXAMPLE)
    arrays = read_arrays(tmp_path / "a.npz")
    change(arrays)
    write_arrays(tmp_path / "a.npz", arrays)
    with pytest.raises(WorkspaceError, match=rf"a\.npz: cannot be read \({words}.*\): delete it and run again"):
        read_record(tmp_path / "a.npz", Branch)


@dataclass(frozen=True)
class Even:
    count: int

    def __post_init__(self) -> None:
        if self.count % 2:
            raise ValueError("an even number is expected")


@dataclass(frozen=True)
class Number:
    count: int


@dataclass(frozen=True)
class Unheard:
    values: set[int]


def test_a_record_that_refuses_its_fields_is_damage(tmp_path: Path) -> None:
    write_record(tmp_path / "a.npz", Number(3))
    with pytest.raises(WorkspaceError, match=r"its content is damaged: an even number is expected"):
        read_record(tmp_path / "a.npz", Even)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (Number(1.5), "1.5 is not of the type"),  # type: ignore[arg-type]
        (Number(True), "True is not of the type"),
        (Unheard({1}), "cannot be stored"),
        (Leaf(np.array(["a"]), "oak", None, None), "an array of <U1"),
        (Leaf(np.zeros(1), "elm", None, None), "'elm' is not of the type"),  # type: ignore[arg-type]
    ],
)
def test_what_is_not_as_annotated_is_not_written(tmp_path: Path, record: object, words: str) -> None:
    with pytest.raises(TypeError, match=words):
        write_record(tmp_path / "a.npz", record)
    assert not list(tmp_path.iterdir())


def test_a_text_that_an_array_would_shorten_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="ends in a zero character"):
        write_record(tmp_path / "a.npz", Branch(None, (), (1, "a\0"), np.zeros(0, dtype=bool), {}))
