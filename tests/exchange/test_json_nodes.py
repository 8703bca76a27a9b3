"""JSON of others: types and places."""

from pathlib import Path

import pytest

from photogram.errors import ExchangeError
from photogram.exchange.formats.json_nodes import Node, read_json


def test_values_have_their_place(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a": [{"b": 1.5}, {"b": "x", "c": null, "d": true, "e": [1, 2]}]}', encoding="utf-8")
    first, second = read_json(path).get("a").items()
    assert first.get("b").number() == 1.5
    assert second.find("c") is None
    assert second.get("d").flag() is True
    assert second.get("e").numbers(2).tolist() == [1, 2]
    assert second.get("f", 7.5).number() == 7.5
    assert [(key, node.place) for key, node in first.entries()] == [("b", f"{path}: a[0]: b")]
    with pytest.raises(ExchangeError, match=r"a\.json: a\[1\]: b: must be a finite number, found 'x'"):
        second.get("b").number()


@pytest.mark.parametrize(
    ("value", "method"),
    [
        (True, "whole"), (-1, "whole"), (2**64, "whole"), (1.0, "whole"), (True, "number"), (10**400, "number"),
        ("1", "number"), (None, "text"), (1, "flag"), ({}, "items"), ([], "get"),
    ],
)  # fmt: skip
def test_other_types_are_refused(value: object, method: str) -> None:
    with pytest.raises(ExchangeError, match=r"^place: (must be|has no)"):
        list(getattr(Node(value, "place"), method)(*(["key"] if method == "get" else [])))


@pytest.mark.parametrize("is_text", [True, False])
def test_numbers_and_flags_may_be_texts_where_a_program_writes_them_so(is_text: bool) -> None:
    node = Node({"a": "1.5", "b": ["1", "2e1"], "c": "4294967295", "d": "false"}, "place", is_text)
    reads = (
        (lambda: node.get("a").number(), 1.5),
        (lambda: node.get("b").numbers(2).tolist(), [1, 20]),
        (lambda: node.get("c").whole(2**32 - 1), 2**32 - 1),
        (lambda: node.get("d").flag(), False),
    )
    for read, expected in reads:
        if is_text:
            assert read() == expected
        else:
            with pytest.raises(ExchangeError, match=r"^place: .: must be"):
                read()
    for text in ("nan", "x", "", "-1", "4294967296", "1" * 5000):
        with pytest.raises(ExchangeError, match="must be a whole number"):
            Node(text, "place", is_text).whole(2**32 - 1)


def test_a_table_is_of_all_the_objects_of_a_list_or_an_object() -> None:
    owners = [{"x": [1, 2]}, {"x": ["3", "4"]}, {}]
    assert Node(owners, "place").table("x", 2, [0, 0]).tolist() == [[1, 2], [3, 4], [0, 0]]
    assert Node({"a": {"x": 1}, "b": {"x": 2}}, "place").table("x", 1).tolist() == [[1], [2]]
    assert Node([], "place").table("x", 2).shape == (0, 2)


@pytest.mark.parametrize(
    "wrong", [{}, {"x": [1]}, {"x": [1, None]}, {"x": [1, 10**400]}, {"x": [1, "nan"]}, 3, {"x": 1}]
)
def test_what_is_no_table_is_refused(wrong: object) -> None:
    with pytest.raises(ExchangeError, match="must be objects whose x are lists of 2 finite numbers"):
        Node([{"x": [1, 2]}, wrong], "place").table("x", 2)


def test_what_is_no_json_has_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a":\n1,,}', encoding="utf-8")
    with pytest.raises(ExchangeError, match=r"a\.json:2: is not JSON"):
        read_json(path)
    with pytest.raises(ExchangeError, match="at most 0 MB are read here"):
        read_json(path, 3)
