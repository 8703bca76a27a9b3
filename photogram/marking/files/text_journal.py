"""The journal of marking as it was before it became a database: lines of JSON, each sealed by the CRC-32 of its bytes.

Read once, to be taken over; nothing writes it any more.
"""

import json
import zlib
from itertools import takewhile
from pathlib import Path
from typing import Any

from photogram.errors import WorkspaceError
from photogram.files.reading import read_whole

_SEAL = len(',"crc":"00000000"}')
_PAIRS = {"pixel": ("u", "v"), "sigma_px": ("sigma_u", "sigma_v"), "raw_pixel": ("raw_u", "raw_v")}
_Record = dict[str, Any]


def _is_whole(line: bytes) -> bool:
    return len(line) > _SEAL and line[-_SEAL:] == b',"crc":"%08x"}' % zlib.crc32(line[:-_SEAL])


def _mark(record: _Record) -> _Record:
    mark: _Record = {key: record[key] for key in ("point", "photograph", "rho", "kind", "time") if key in record}
    mark |= {name: (record[u], record[v]) for name, (u, v) in _PAIRS.items() if u in record}
    return mark | {"is_doubtful": record.get("doubtful", False)}


def _fields(record: _Record) -> _Record:
    fields = {key: value for key, value in record.items() if key not in ("n", "at", "do", "crc", "visible")}
    if record["do"] == "mark":
        return {"marks": [_mark(mark) for mark in record["marks"]]}
    if record["do"] == "confirm":
        return {"proposals": [{"mark": _mark(one), "score": one["score"]} for one in record["proposals"]]}
    if record["do"] == "not_visible":
        return fields | {"is_visible": record.get("visible", False)}
    if record["do"] == "remove":
        return {"keys": record["places"]}
    return {"point": fields} if record["do"] == "point" else fields


def read_text_journal(path: Path, most_bytes: int) -> tuple[tuple[str, str, str], ...]:
    """Return time, kind and fields (JSON) of the actions of a journal; a last line that was cut off is left out.

    Raises WorkspaceError where it cannot be read, is no journal, or is damaged.
    """
    line, rows = 1, []
    try:
        lines = read_whole(path, most_bytes).split(b"\n")[:-1]
        whole = list(takewhile(_is_whole, lines))
        if (lines and not whole) or any(map(_is_whole, lines[len(whole) :])):
            line = len(whole) + 1
            raise ValueError("corrupt record inside the journal")
        for line, data in enumerate(whole[1:], 2):
            record = json.loads(data)
            if record["n"] != line - 1:
                raise ValueError("lines are missing before it")
            rows.append((str(record["at"]), str(record["do"]), json.dumps(_fields(record))))
    except OSError as error:
        raise WorkspaceError(f"{path}: cannot be read ({error.strerror}): check its name and folder") from error
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise WorkspaceError(f"{path}:{line}: {error}: restore a copy of it, or move it away") from error
    return tuple(rows)
