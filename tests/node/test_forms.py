"""Bodies of requests: taken apart as they come, to the disk and not into memory."""

import asyncio
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nodes import BOUNDARY, FULL, multipart
from starlette.requests import Request
from starlette.types import Message

from photogram.node import forms
from photogram.node.forms import Form, received_form, small_body
from photogram.node.received import Room
from photogram.node.refusals import RequestError

FORM = f"multipart/form-data; boundary={BOUNDARY}"
WIDE = Room(10**12)


def request(pieces: Iterator[bytes] | list[bytes], kind: str = FORM, cut: bool = False, **headers: str) -> Request:
    """Return a request with a body in pieces; one that is ``cut`` ends with the connection."""
    source, ended = iter(pieces), False

    async def receive() -> Message:
        nonlocal ended
        piece = next(source, None)
        if piece is not None:
            return {"type": "http.request", "body": piece, "more_body": True}
        if cut:
            return {"type": "http.disconnect"}
        return {"type": "http.request", "body": b"", "more_body": False}

    given_headers = {"content-type": kind, **{name.replace("_", "-"): value for name, value in headers.items()}}
    scope = {"type": "http", "method": "POST", "headers": [(k.encode(), v.encode()) for k, v in given_headers.items()]}
    return Request(scope, receive)


def taken(body: bytes, folder: Path, room: Room = WIDE, size: int = 1 << 16, **more: Any) -> Form:
    pieces = [body[at : at + size] for at in range(0, len(body), size)]
    return asyncio.run(received_form(request(pieces, **more), folder, room))


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.lists(st.binary(max_size=300) | st.just(f"\r\n--{BOUNDARY}".encode()[:-1]), max_size=4),
    size=st.integers(1, 400),
)
def test_a_form_is_read_back_however_it_is_cut_into_pieces(
    content: list[bytes], size: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("form")
    files = [(f"ä {number}.jpg", own) for number, own in enumerate(content)]
    form = taken(multipart({"name": "Größe", "options": "[]"}, files), folder, size=size)
    assert form.fields == {"name": "Größe", "options": "[]"}
    assert [(path.name, path.read_bytes()) for path in form.files] == files


def test_a_huge_file_goes_to_the_disk_and_not_into_memory(tmp_path: Path) -> None:
    head, _, tail = multipart({}, [("a.jpg", b"SPLIT")]).partition(b"SPLIT")
    piece, count = bytes(1 << 16), 1600

    def pieces() -> Iterator[bytes]:
        yield head
        for _ in range(count):
            yield piece
        yield tail

    tracemalloc.start()
    try:
        form = asyncio.run(received_form(request(pieces()), tmp_path, WIDE))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert form.files[0].stat().st_size == count * len(piece) > 100_000_000
    assert peak < 8_000_000


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (multipart({}, [("a.jpg", b"x" * 100)])[:-20], "ends before its last part"),
        (b"no form at all", "damaged"),
        (b"", "ends before its last part"),
        (multipart({"name": "x" * (forms.MOST_FIELD_BYTES + 1)}), "too large"),
        (multipart({str(n): "x" for n in range(200)}), "too large"),
        (multipart({}, [("../../a.jpg", b"x")]), "send names without folders"),
        (multipart({}, [("", b"x")]), "send names without folders"),
    ],
)
def test_damaged_forms_are_refused(tmp_path: Path, body: bytes, said: str) -> None:
    with pytest.raises(RequestError) as caught:
        taken(body, tmp_path / "in")
    assert said in str(caught.value)
    assert not list(tmp_path.rglob("a.jpg")) or said == "ends before its last part"


def test_a_connection_that_ends_is_told(tmp_path: Path) -> None:
    body = multipart({}, [("a.jpg", b"x" * 1000)])
    with pytest.raises(RequestError, match="the connection ended before all was sent"):
        asyncio.run(received_form(request([body[:500]], cut=True), tmp_path, WIDE))


def test_a_client_that_falls_silent_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forms, "WAIT_S", 0.05)

    async def receive() -> Message:
        await asyncio.sleep(60)
        raise AssertionError

    scope = {"type": "http", "method": "POST", "headers": [(b"content-type", FORM.encode())]}
    with pytest.raises(RequestError, match="nothing came for"):
        asyncio.run(received_form(Request(scope, receive), tmp_path, WIDE))


@pytest.mark.parametrize("length", ["", "100000"])
def test_what_there_is_no_room_for_is_refused_before_it_is_written_or_while(tmp_path: Path, length: str) -> None:
    headers = {"content_length": length} if length else {}
    with pytest.raises(RequestError, match="there is no room"):
        taken(multipart({}, [("a.jpg", b"x" * 100_000)]), tmp_path, Room(50_000), size=1000, **headers)
    assert sum(path.stat().st_size for path in tmp_path.rglob("a.jpg")) <= 50_000


@pytest.mark.parametrize("kind", ["multipart/form-data", "multipart/form-data; boundary=", f"{FORM}{'x' * 300}"])
def test_a_form_without_a_boundary_is_refused(tmp_path: Path, kind: str) -> None:
    with pytest.raises(RequestError, match="boundary"):
        taken(b"", tmp_path, kind=kind)


def small(body: bytes, kind: str) -> dict[str, str]:
    return asyncio.run(small_body(request([body], kind)))


def test_small_bodies_are_forms_or_json() -> None:
    assert small(b"uuid=a&options=%5B%5D", "application/x-www-form-urlencoded") == {"uuid": "a", "options": "[]"}
    assert small(b'{"uuid": "a", "options": []}', "application/json; charset=utf-8") == {"uuid": "a", "options": "[]"}
    assert small(b"", "application/json") == {}


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (b"[1]", "application/json"),
        (b"{", "application/json"),
        (b"\xff", "application/json"),
        (b"x" * (2 << 20), "text/plain"),
        (b"&".join(b"a=1" for _ in range(200)), "application/x-www-form-urlencoded"),
    ],
)
def test_other_small_bodies_are_refused(body: bytes, kind: str) -> None:
    with pytest.raises(RequestError):
        small(body, kind)


@pytest.mark.skipif(not FULL.exists(), reason="this system has no device that is always full")
def test_a_full_disk_is_the_error_of_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forms, "new_file", lambda _: FULL.open("wb"))
    with pytest.raises(OSError, match="No space left on device"):
        taken(multipart({}, [("a.jpg", b"x" * (1 << 20))]), tmp_path)
