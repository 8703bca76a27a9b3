"""Pixels of programs that count from the outer corner of the top-left pixel, whose centre is (0.5, 0.5) to them."""

from decimal import Context, Decimal

_HALF = Decimal("0.5")
# enough digits for the sum of a half and any double that is not below 1e-300
_CONTEXT = Context(prec=330)
_SMALLEST, _LARGEST = 1e-300, 1e300


def from_corner(text: str) -> float:
    """Return the coordinate of photogram, half a pixel less, of a number as it is written: rounded once, not twice."""
    value = float(text)
    if not _SMALLEST < abs(value) < _LARGEST:
        return value - 0.5
    return float(_CONTEXT.subtract(Decimal(text), _HALF))


def to_corner(value: float) -> str:
    """Return the number to write, half a pixel more, with all digits: ``from_corner`` gives the same double again."""
    return str(_CONTEXT.add(Decimal(repr(value)), _HALF))
