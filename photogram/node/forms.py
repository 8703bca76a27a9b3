"""Bodies of requests: forms with files, which go to the disk piece by piece, and small forms or JSON, which do not."""

import asyncio
import json
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO
from urllib.parse import parse_qs

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request

from photogram.files.atomic import make_folder
from photogram.node.received import Room, checked_name
from photogram.node.refusals import RequestError

MOST_FIELD_BYTES, MOST_FIELDS, MOST_FILES = 1 << 20, 100, 10_000
"""Of a form: of a value that is no file, and how many values and files there may be."""

WAIT_S = 120.0
"""How long a request may be silent before it is given up."""

_PIECE_BYTES = 1 << 20


@dataclass
class Form:
    """A form that has arrived."""

    fields: dict[str, str] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)


async def _pieces(request: Request) -> AsyncIterator[bytes]:
    """Yield the body in pieces of some size. Raises RequestError where the client falls silent or is gone."""
    piece, stream = bytearray(), request.stream()
    while True:
        try:
            async with asyncio.timeout(WAIT_S):
                chunk = await anext(stream, None)
        except TimeoutError as error:
            raise RequestError(f"nothing came for {WAIT_S:g} s: send it again") from error
        except ClientDisconnect as error:
            raise RequestError("the connection ended before all was sent: send it again") from error
        if chunk is None:
            break
        piece += chunk
        if len(piece) >= _PIECE_BYTES:
            yield bytes(piece)
            piece.clear()
    if piece:
        yield bytes(piece)


def new_file(path: Path) -> BinaryIO:
    """Return a file to write to, where there is none yet."""
    return path.open("xb")


async def small_body(request: Request) -> dict[str, str]:
    """Return the values of a small body, of a form or of JSON; what is no text in it is written as JSON. Raises
    RequestError where it is neither, or too large."""
    body = bytearray()
    async for piece in _pieces(request):
        body += piece
        if len(body) > MOST_FIELD_BYTES:
            raise RequestError(f"the request is too large: up to {MOST_FIELD_BYTES} bytes are taken")
    try:
        text = body.decode("utf-8")
        if request.headers.get("content-type", "").startswith("application/json"):
            values = json.loads(text or "{}")
            if not isinstance(values, dict):
                raise ValueError("no object")
            return {str(name): value if isinstance(value, str) else json.dumps(value) for name, value in values.items()}
        return {name: values[-1] for name, values in parse_qs(text, keep_blank_values=True, max_num_fields=100).items()}
    except (ValueError, RecursionError) as error:
        raise RequestError(f"the request cannot be read: {error}") from error


async def received_form(request: Request, folder: Path, room: Room) -> Form:
    """Return a form whose files go into ``folder``, each under its own name, within folders of their numbers.

    Raises RequestError where the body is none, a file's name is none, there is no room, or the connection ends;
    OSError where the disk is full. Whoever calls removes the folder.
    """
    if not request.headers.get("content-type", "").startswith("multipart/form-data"):
        return Form(await small_body(request))
    length = request.headers.get("content-length", "")
    if length.isdecimal():
        room.check(int(length))
    reader = _Reader(folder, room, _boundary(request.headers))
    try:
        async for piece in _pieces(request):
            await run_in_threadpool(reader.take, piece)
        return reader.finished()
    finally:
        reader.close()


def _boundary(headers: Mapping[str, str]) -> bytes:
    boundary = parse_options_header(headers["content-type"])[1].get(b"boundary", b"")
    if not 0 < len(boundary) <= 200:
        raise RequestError("the form names no boundary of its parts")
    return boundary


class _Reader:
    """Takes a form apart as it comes."""

    def __init__(self, folder: Path, room: Room, boundary: bytes) -> None:
        self._folder, self._left = folder, room.bytes
        self._form = Form()
        self._header, self._value = b"", b""
        self._headers: dict[bytes, bytes] = {}
        self._name = ""
        self._text: bytearray | None = None
        self._file: BinaryIO | None = None
        self._complete = False
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._begin,
                "on_header_field": self._header_field,
                "on_header_value": self._header_value,
                "on_header_end": self._header_end,
                "on_headers_finished": self._open,
                "on_part_data": self._data,
                "on_part_end": self._end,
                "on_end": self._finish,
            },
        )

    def take(self, piece: bytes) -> None:
        """Take the next piece of the body."""
        try:
            self._parser.write(piece)
        except FormParserError as error:
            raise RequestError(f"the form is damaged: {error}") from error

    def finished(self) -> Form:
        """Return the form. Raises RequestError where its end is missing."""
        if not self._complete:
            raise RequestError("the form ends before its last part: send it again")
        return self._form

    def close(self) -> None:
        """Close what is still open."""
        if self._file is not None:
            self._file.close()

    def _begin(self) -> None:
        self._headers, self._header, self._value = {}, b"", b""

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _header_end(self) -> None:
        self._headers[self._header.lower()] = self._value
        self._header = self._value = b""

    def _open(self) -> None:
        _, options = parse_options_header(self._headers.get(b"content-disposition", b""))
        self._name = options.get(b"name", b"").decode("utf-8", "replace")
        if b"filename" not in options:
            self._text = bytearray()
            return
        name = checked_name(options[b"filename"].decode("utf-8", "replace"))
        if len(self._form.files) >= MOST_FILES:
            raise RequestError(f"up to {MOST_FILES} files are taken at a time: send the others afterwards")
        path = self._folder / str(len(self._form.files)) / name
        make_folder(path.parent)
        self._file = new_file(path)
        self._form.files.append(path)

    def _data(self, data: bytes, start: int, end: int) -> None:
        if self._file is not None:
            self._left -= end - start
            Room(self._left).check(0)
            self._file.write(memoryview(data)[start:end])
        elif self._text is not None:
            self._text += data[start:end]
            if len(self._text) > MOST_FIELD_BYTES or len(self._form.fields) > MOST_FIELDS:
                raise RequestError("the form is too large: files go into parts with a file name")

    def _end(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
        elif self._text is not None:
            self._form.fields[self._name] = self._text.decode("utf-8", "replace")
            self._text = None

    def _finish(self) -> None:
        self._complete = True
