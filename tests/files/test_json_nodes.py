"""JSON of others: types and places."""

from __future__ import annotations

from pathlib import Path

import pytest

from photogram.errors import ExchangeError
from photogram.files.exchange.pix4d.json_nodes import Node, read_json


def test_values_have_their_place(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a": [{"b": 1.5}, {"b": "x", "c": null, "d": true, "e": [1, 2]}]}', encoding="utf-8")
    first, second = read_json(path).get("a").items()
    assert first.get("b").number() == 1.5
    assert second.find("c") is None
    assert second.get("d").flag() is True
    assert second.get("e").numbers(2).tolist() == [1, 2]
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
