"""The variables of the joint adjustment: their keys, as GTSAM has them, and their names in a surveyor's words."""

import re

POSE, TIE_POINT, CONTROL_POINT, GNSS_OFFSET, COMMON_ERROR, RIG, CALIBRATION = "x", "l", "g", "o", "e", "r", "k"
DATUM = "datum"  # not a variable: the block as a whole, by the parts of photogram.factors.datum

INDEX = (1 << 56) - 1
"""What of a key is the index."""

WORDS = {
    POSE: "photograph",
    TIE_POINT: "tie point",
    CONTROL_POINT: "control point",
    GNSS_OFFSET: "GNSS offset of flight",
    COMMON_ERROR: "common error",
    RIG: "relative pose of camera",
    CALIBRATION: "calibration of camera",
}


def key(kind: str, index: int) -> int:
    """Return the key of variable ``index`` of one of the kinds above: its first byte, and the other seven."""
    return ord(kind) << 56 | index


def kind_and_index(variable: int) -> tuple[str, int]:
    """Return the kind and the index of a key."""
    return chr(variable >> 56), variable & INDEX


def indeterminate_variable(message: str) -> tuple[str, int] | None:
    """Read kind and index of the variable that GTSAM's indeterminate-system error names, None when it names none."""
    match = re.search(r"near variable\s+(\d+)", message) or re.search(r"Symbol:\s*([a-z])(\d+)", message)
    if match is None:
        return None
    if len(match.groups()) == 2:
        return match.group(1), int(match.group(2))
    return kind_and_index(int(match.group(1)))
