"""How an input is spoiled: bits, bytes and cuts for any file; numbers, words and lines for texts; values for JSON."""

import io
import json
import re
import struct
import zipfile
from collections.abc import Callable
from random import Random
from typing import Any

NUMBERS = (
    "1e308", "-1e308", "1e-320", "1e400", "-1e400", "nan", "inf", "-inf", ".nan", ".inf", "9" * 400, "-" + "9" * 5000,
    "0", "-0", "-1", "1", "0.5", "2147483648", "4294967295", "18446744073709551616", "12345678", "1,5", "0x10",
    "1_000", "1e", "1.2.3", "١٢", "", "1e200", "1e18", "1e6", "-180.5", "1/0", "0/0",
)  # fmt: skip
WORDS = (
    "=cmd|' /C calc'!A0", "@SUM(A1)", "\x1b[31m", "\x1b]0;x\x07", "$x$", "$", "x" * 300, "x" * 20_000,
    "9" * 100_000, "[" * 100_000, "1 " * 50_000, "-" * 100_000, "\u00a0" * 50_000, "a,1," * 20_000,
    "../../etc/passwd", "/dev/zero", "a\0b", "\u202eabc", "{{7*7}}", "<script>alert(1)</script>", "%s%n", "null",
    "~", "[]", "{}", "true",
    "yes", "&a [*a]", "!!python/object:os.system x", "# ", "'", '"', ",", ";", "\t", "\u00e9", "\U0001f6f0", "\u00a0",
    "\r",
 "EPSG:4326", "EPSG:99999", "+proj=utm +zone=32", "control", "check", "free", "0001-01-01T00:00:00",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, "", "abc", "$x$", "\x1b[31m", 0, -1, 1, 1e308, -1e308, 1e-320, 10**400, 2**63, True, False, [], {}, [[]],
    [None],
    [1, 2], [1, 2, 3, 4], {"a": 1}, "1e5", "x" * 5000, [1e308, 1e308, 1e308], ["a", "b", "c"],
)  # fmt: skip
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[\w.:]+")


# ---- any file ------------------------------------------------------------------------------------------------------


def cut(data: bytes, random: Random) -> bytes:
    """Cut a file off, at any place or within its last bytes."""
    return data[: random.randrange(len(data) + 1)] if random.random() < 0.7 else data[: -random.randint(1, 60)]


def _place(data: bytes | bytearray, random: Random) -> int:
    """Return a place in the file; half of the time in its first bytes, where headers are."""
    if not data:
        return 0
    return random.randrange(min(len(data), 500)) if random.random() < 0.5 else random.randrange(len(data))


def _flip(data: bytearray, random: Random) -> None:
    data[_place(data, random)] ^= 1 << random.randrange(8)


def _overwrite(data: bytearray, random: Random) -> None:
    form = random.choice("<HIQd") if random.random() < 0.5 else ">" + random.choice("HIQd")
    form = form if form[0] in "<>" else "<" + form
    form = form if len(form) == 2 else "<I"
    if form[1] == "d":
        value: float = random.choice((0.0, -1.0, 1e308, 1e-320, float("nan"), float("inf"), 1e-9))
    else:
        bits = {"H": 16, "I": 32, "Q": 64}[form[1]]
        value = random.choice((0, 1, 2**bits - 1, 2 ** (bits - 1), 2 ** (bits - 1) - 1, random.getrandbits(bits)))
    packed = struct.pack(form, value)
    place = _place(data, random)
    data[place : place + len(packed)] = packed


def _noise(data: bytearray, random: Random) -> None:
    place = _place(data, random)
    data[place : place + random.randint(1, 8)] = random.randbytes(random.randint(0, 8))


def _repeat(data: bytearray, random: Random) -> None:
    start, place = _place(data, random), _place(data, random)
    data[place:place] = data[start : start + random.randint(1, 2000)]


def _zeros(data: bytearray, random: Random) -> None:
    place = _place(data, random)
    data[place : place + random.randint(1, 500)] = bytes(random.randint(1, 500))


def spoil_bytes(data: bytes, random: Random) -> bytes:
    """Change one place of a file, sometimes several."""
    spoilt = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 5))):
        if spoilt:
            random.choice((_flip, _flip, _overwrite, _overwrite, _noise, _repeat, _zeros))(spoilt, random)
    return bytes(spoilt)


# ---- texts ---------------------------------------------------------------------------------------------------------


def _replace(pattern: re.Pattern[str], others: tuple[str, ...], text: str, random: Random) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text + random.choice(others)
    match = random.choice(found)
    return text[: match.start()] + random.choice(others) + text[match.end() :]


def _lines(text: str, random: Random) -> str:
    lines = text.split("\n")
    i, j = random.randrange(len(lines)), random.randrange(len(lines))
    kind = random.randrange(6)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(i, lines[j])
    elif kind == 2:
        lines[i], lines[j] = lines[j], lines[i]
    elif kind == 3:
        lines[i] = " " * random.randint(1, 8) + lines[i]
    elif kind == 4:
        lines[i] = lines[i][: random.randint(0, len(lines[i]))]
    else:
        lines[i] += random.choice((",", ";", "\t1", " x", ": 1", "#"))
    return "\n".join(lines)


def _nest(text: str, random: Random) -> str:
    deep = random.choice((30, 1000, 20_000))
    begin, end = random.choice((("[", "]"), ("{a: ", "}"), ("- ", ""), ("(", ")"), ("<a>", "</a>")))
    place = random.randrange(len(text) + 1)
    return text[:place] + begin * deep + end * deep + text[place:]


def _encoded(text: str, random: Random) -> bytes:
    kind = random.randrange(12)
    data = text.encode("utf-8", "surrogateescape")
    if kind == 0:
        return text.encode("utf-16", "replace")
    if kind == 1:
        return text.encode("latin-1", "replace")
    if kind == 2:
        return b"\xef\xbb\xbf" + data
    return data.replace(b"\n", b"\r\n") if kind == 3 else data


def spoil_text(data: bytes, random: Random) -> bytes:
    """Change numbers, words or lines of a text; sometimes its encoding, sometimes its bytes."""
    if random.random() < 0.1:
        return spoil_bytes(data, random)
    text = data.decode("utf-8", "surrogateescape")
    changes: tuple[Callable[[str, Random], str], ...] = (
        lambda t, r: _replace(_NUMBER, NUMBERS, t, r),
        lambda t, r: _replace(_NUMBER, NUMBERS, t, r),
        lambda t, r: _replace(_NUMBER, NUMBERS, t, r),
        lambda t, r: _replace(_NUMBER, WORDS, t, r),
        lambda t, r: _replace(_WORD, WORDS, t, r),
        lambda t, r: _replace(_WORD, NUMBERS, t, r),
        _lines,
        _lines,
        _nest,
    )
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        text = random.choice(changes)(text, random)
    return _encoded(text, random)


# ---- JSON ----------------------------------------------------------------------------------------------------------


def _holders(value: Any, found: list[tuple[Any, Any]]) -> None:
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        found.append((value, key))
        _holders(part, found)


def spoil_json(data: bytes, random: Random) -> bytes:
    """Change, remove or repeat values of a JSON text; sometimes its bytes."""
    if random.random() < 0.15:
        return spoil_bytes(data, random) if random.random() < 0.5 else spoil_text(data, random)
    value = json.loads(data.decode("utf-8-sig"))
    for _ in range(random.choice((1, 1, 1, 3))):
        places: list[tuple[Any, Any]] = []
        _holders(value, places)
        if not places:
            break
        # the same share for every depth, or the long lists of marks would get nearly all
        outermost = [place for place in places if place[0] is value]
        holder, key = random.choice(places if random.random() < 0.5 else outermost)
        kind = random.random()
        if kind < 0.7:
            holder[key] = random.choice(VALUES)
        elif isinstance(holder, dict) or random.random() < 0.5:
            del holder[key]
        else:
            holder.insert(key, holder[key])
    return json.dumps(value).encode()


# ---- files of several kinds ----------------------------------------------------------------------------------------


def spoil_archive(data: bytes, random: Random) -> bytes:
    """Change one file of a ZIP archive as its content asks for; sometimes the archive."""
    if random.random() < 0.2:
        return spoil_bytes(data, random)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        files = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    name = random.choice(list(files))
    files[name] = cut(files[name], random) if random.random() < 0.2 else spoil_any(files[name], random)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def spoil_any(data: bytes, random: Random) -> bytes:
    """Change a file as its content asks for: an archive, JSON, a text, or bytes."""
    if data.startswith(b"PK"):
        return spoil_archive(data, random)
    if b"\0" in data:
        return spoil_bytes(data, random)
    return spoil_json(data, random) if data.lstrip()[:1] in (b"{", b"[") else spoil_text(data, random)
