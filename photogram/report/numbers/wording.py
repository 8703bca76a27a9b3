"""How figures, sentences and settings are written on the report page."""

import math
import re
from collections.abc import Callable, Mapping

from markupsafe import Markup, escape

from photogram.report.numbers.traffic_lights import number
from photogram.settings.settings import settings_of
from photogram.surface.dense.tile_matching import DenseSettings
from photogram.wording import NO_FIGURE, THIN_SPACE, percent

UNIT = "units"
"""What lengths of a network without scale are in, after their figures."""

_LENGTH = re.compile(r"(?<=\d)([\s\u202f]|&#8239;)?(mm|cm|km|m)(²|³|2)?(?![A-Za-z0-9_])")
_POWERS = {"m": "", "mm": "10⁻³ ", "cm": "10⁻² ", "km": "10³ "}


def fixed(value: object, digits: int = 3) -> str:
    """Write a number with so many decimals, its thousands apart; an en dash where there is none."""
    figure = number(value)
    if not math.isfinite(figure):
        return NO_FIGURE
    text = f"{figure:,.{digits}f}".replace(",", THIN_SPACE)
    return "−" + text[1:] if text.startswith("-") and float(f"{figure:.{digits}f}") else text.lstrip("-")


def signed(value: object, digits: int = 3) -> str:
    """Write a number as `fixed` does, with its sign."""
    figure = number(value)
    return "+" + fixed(figure, digits) if round(figure, digits) > 0 else fixed(figure, digits)


def small(value: object, significant: int = 4) -> str:
    """Write a number of unknown size with so many digits, as powers of ten where that is shorter."""
    figure = number(value)
    if not math.isfinite(figure):
        return NO_FIGURE
    text = f"{figure:.{significant}g}"
    mantissa, _, exponent = text.partition("e")
    return (mantissa + (f"·10^{int(exponent)}" if exponent else "")).replace("-", "−")


def whole(value: object) -> str:
    """Write a count, its thousands apart."""
    return fixed(value, 0)


def share(value: object, digits: int = 0) -> str:
    """Write a part of one in per cent, as ``percent`` does."""
    return percent(number(value), digits)


def probability(value: object, equals: str = "") -> str:
    """Write a probability; of one that is tiny, only that it is."""
    figure = number(value)
    return "< 0.001" if figure < 0.001 else f"{equals}{fixed(figure)}"


def memory(value: object) -> str:
    """Write bytes in MiB."""
    return fixed(number(value) / 2**20, 0)


def rich(text: object) -> Markup:
    """Write RMSE_H and its kind with a subscript."""
    written = str(escape(text))
    for letter in ("H1", "H2", "V1", "V2", "3D", "H", "V", "x", "y"):
        written = written.replace(f"RMSE_{letter}", f"RMSE<sub>{letter}</sub>")
    return Markup(written)


def plain(value: object) -> str:
    """Write a value of any kind as text: entries of a block as `name: value`, lists with commas."""
    if isinstance(value, Mapping):
        entries = ((str(k).replace("_", " "), v) for k, v in value.items())
        return "; ".join(f"{k} ({plain(v)})" if isinstance(v, Mapping) else f"{k}: {plain(v)}" for k, v in entries)
    if isinstance(value, list | tuple):
        return ", ".join(plain(v) for v in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return small(value)
    return NO_FIGURE if value is None else str(value)


def capitalised(text: object) -> str:
    """Write a sentence with a capital at its beginning and without a full stop at its end."""
    sentence = str(text or "").strip().removesuffix(".")
    # k2, sigma0 and names of files keep their letters
    as_it_is = any(c.isdigit() or c in "._" for c in sentence.partition(" ")[0])
    return sentence if as_it_is else sentence[:1].upper() + sentence[1:]


def css_string(text: object, most: int) -> Markup:
    """Write a text of at most so many characters as a string of CSS that no character can end or leave."""
    words = " ".join(str(text or "").split())
    words = words if len(words) <= most else words[: most - 1].rstrip() + "…"
    return _css_quoted(words)


def css_page_number(text: str) -> Markup:
    """Write a text with the number of the page for its first | and that of all pages for its second, for CSS."""
    before, between, after = text.split("|")
    ending = [_css_quoted(after)] if after else []
    return Markup(" ").join([_css_quoted(before), "counter(page)", _css_quoted(between), "counter(pages)", *ending])


def _css_quoted(words: str) -> Markup:
    plain_letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 .,-"
    return Markup('"' + "".join(c if c in plain_letters else f"\\{ord(c):06x}" for c in words) + '"')


def matching_settings(settings: Mapping[str, object]) -> str:
    """Write the settings of the dense matching in words with their units."""
    known = {setting.name: setting for setting in settings_of(DenseSettings)}
    words = []
    for name, value in settings.items():
        title, unit = (known[name].title, known[name].unit) if name in known else (name.replace("_", " "), "")
        words.append(f"{title} {plain(value)} {unit}".rstrip())
    return "; ".join(words)


FILTERS: Mapping[str, Callable[..., str]] = {
    filter_.__name__: filter_
    for filter_ in (
        fixed, signed, small, whole, share, probability, memory, rich, plain, capitalised, css_string,
        css_page_number, matching_settings,
    )
}  # fmt: skip
"""What templates of pages write their figures and sentences with."""


def without_metres(text: str) -> str:
    """Return a sentence of a network without scale with the units of its lengths called UNIT: 3 mm are 3 10⁻³ units."""
    return _LENGTH.sub(lambda length: f" {_POWERS[length[2]]}{UNIT}{length[3] or ''}", text)
