"""LAZ files written whole or not at all, with the reason where they cannot be: lazrs says of a full disk only that a
call of `write` failed."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

import lazrs

from photogram.files.atomic import replacing


class _Remembering:
    """A stream that keeps what its last failure was."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)

    def _kept(self, call: Callable[[], int | None]) -> int:
        """Return what a call of the stream returns, and keep its failure."""
        try:
            return call() or 0
        except OSError as error:
            self.failure = error
            raise

    def write(self, data: bytes) -> int:
        """Write bytes, as the stream does."""
        return self._kept(lambda: self._stream.write(data))

    def flush(self) -> None:
        """Write what is left, as the stream does."""
        self._kept(self._stream.flush)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to another place, as the stream does, which writes what is left."""
        return self._kept(lambda: self._stream.seek(offset, whence))


@contextmanager
def laz_stream(path: Path) -> Iterator[BinaryIO]:
    """Give a stream that becomes the file ``path`` when all went well, as ``replacing``, to be written by laspy or
    lazrs. Raises WorkspaceError where it cannot be written."""
    with replacing(path) as partial, partial.open("wb+") as stream:
        remembering = _Remembering(stream)
        try:
            yield cast("BinaryIO", remembering)
        except (lazrs.LazrsError, OSError) as error:
            failure = remembering.failure or (error if isinstance(error, OSError) else OSError(str(error)))
            raise failure from None
