"""Words of messages: shares in per cent, and that all of the program writes them with one function."""

import re
from pathlib import Path

import numpy as np
import pytest

import photogram
from photogram.wording import percent, printable

BY_HAND = re.compile(r"%\}|\}\s?%[^.0-9]|\b100(\.0)? ?\* ?[a-z][^\n]*%")
"""A share that is formatted on the spot: rounding may make all or nothing of it."""
OTHERS = {"terminal/time_left.py", "amendments/gross_errors/blunder_naming.py", "wording.py"}
"""How far work is, which may not be ahead of it, a difference with its sign, and the function itself."""


@pytest.mark.parametrize(
    ("share", "digits", "text"),
    [
        (0.0, 0, "0 %"), (1.0, 0, "100 %"), (1.0, 1, "100.0 %"), (0.5, 0, "50 %"), (0.604, 1, "60.4 %"),
        (0.9972, 0, "99.7 %"), (0.9996, 0, "99.96 %"), (0.9996, 1, "99.96 %"), (0.999997, 0, "> 99.99 %"),
        (0.004, 0, "0.4 %"), (0.0004, 0, "0.04 %"), (0.00027, 2, "0.03 %"), (3e-7, 0, "< 0.01 %"),
        (1.003, 0, "100.3 %"), (2.5, 0, "250 %"), (np.nan, 0, "–"),
    ],
)  # fmt: skip
def test_shares(share: float, digits: int, text: str) -> None:
    assert percent(share, digits) == text.replace(" ", "\u202f")


def test_a_terminal_is_shown_shares_and_obeys_nothing() -> None:
    assert printable(percent(0.833, 1)) == percent(0.833, 1)
    assert printable("a\x1b[2J\u2028b\nc") == "a\\x1b[2J\\u2028b\nc"


def test_a_part_is_neither_all_nor_nothing() -> None:
    rng = np.random.default_rng(1)
    parts = np.concatenate(
        [rng.uniform(0, 1, 200), 10.0 ** rng.uniform(-12, 0, 200), 1 - 10.0 ** rng.uniform(-12, 0, 200)]
    )
    for part in parts[(parts > 0.0) & (parts < 1.0)].tolist():
        for digits in range(3):
            text = percent(part, digits).removesuffix("\u202f%")
            limit = text[:1] in "<>"
            written = float(text.lstrip("<>\u202f")) / 100
            assert 0.0 < written < 1.0, (part, digits, text)
            assert (part < written if text[0] == "<" else part > written) if limit else abs(written - part) <= 0.0051


def test_no_module_and_no_page_writes_a_share_by_itself() -> None:
    root = Path(photogram.__file__).parent
    found = [
        f"{path.relative_to(root)}:{number}"
        for path in sorted([*root.rglob("*.py"), *root.rglob("*.jinja")])
        if path.relative_to(root).as_posix() not in OTHERS
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if BY_HAND.search(line.replace("{%", "").replace("%}", "") if path.suffix == ".jinja" else line)
    ]
    assert not found
