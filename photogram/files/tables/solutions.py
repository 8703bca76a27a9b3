"""Kinds of GNSS solutions as programs write them: RTKLIB's Q, DJI's RtkFlag, or words."""

from collections.abc import Mapping

from photogram.gnss import Solution, solution_of_rtk_flag

_RTKLIB_Q: Mapping[int, Solution] = {
    1: "fix", 2: "float", 3: "single", 4: "single", 5: "single", 6: "float",
}  # fmt: skip
"""RTKLIB's Q (manual 2.4.2, B.1): fix, float, SBAS, DGPS, single, PPP, which converges like a float."""

_WORDS: tuple[tuple[str, Solution], ...] = (
    ("fix", "fix"), ("float", "float"), ("single", "single"), ("auto", "single"), ("dgps", "single"),
    ("dgnss", "single"), ("sbas", "single"), ("ppp", "float"),
)  # fmt: skip
_UNFIXED = ("no fix", "nofix", "not fixed", "unfixed", "none")


def solution_of(text: str) -> Solution | None:
    """Return the solution of RTKLIB's Q, of DJI's RtkFlag, or of words such as FIX and "float"; unknown where the text
    is empty, None where it says none of these."""
    word = text.strip().lower()
    if not word:
        return "unknown"
    if word.isdecimal() and len(word) < 10:
        number = int(word)
        return _RTKLIB_Q.get(number) or solution_of_rtk_flag(number)
    if any(unfixed in word for unfixed in _UNFIXED):
        return "single"
    return next((solution for part, solution in _WORDS if part in word), None)
