"""XML of others: lines, text, paths, and what is refused."""

from pathlib import Path

import pytest

from photogram.errors import ExchangeError
from photogram.files.xml_elements import elements_of

PATH = Path("a.xml")


def test_elements_have_their_lines_and_text() -> None:
    root = elements_of(b'<a>\n <b n="1"> x </b>\n <b><c>y</c></b>\n</a>', PATH, ExchangeError, "remedy")
    first, second = root.all("a", "b")
    assert (first.line, first.text, first.attributes["n"]) == (2, "x", "1")
    assert [c.text for c in root.below("c")] == ["y"]
    assert second.first("d") is None


def test_more_elements_than_programs_write_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photogram.files.xml_elements.MOST_ELEMENTS", 10)
    with pytest.raises(ExchangeError, match="more than 10 elements"):
        elements_of(b"<a>" + b"<b/>" * 10 + b"</a>", PATH, ExchangeError, "remedy")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"<a>\n<b></a>", "a.xml:2: is not valid XML"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "a.xml:1: is XML that is not read"),
        (b"<a>" * 60 + b"</a>" * 60, "too deep"),
        (b"\xff\xfe\x00", "a.xml:1"),
        (b"", "a.xml:1"),
        (b'<?xml version="1.0" encoding="nonsense"?><a/>', "a.xml:1"),
    ],
)
def test_what_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(ExchangeError, match=message):
        elements_of(data, PATH, ExchangeError, "remedy")
