"""report.json read back, whole and checked: the one reader for the page, the view and other programs."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from jinja2 import TemplateError
from pydantic import ValidationError
from pydantic_core import from_json

from photogram.errors import PhotogramError, ReportError
from photogram.files.reading import read_whole
from photogram.report.record.json_schema import report_types
from photogram.report.record.report import Report, oriented
from photogram.wording import printable, shortened

MOST_BYTES = 500_000_000
"""Of report.json: some 100 000 photographs."""

NEEDED = ("photogram", "crs", "cameras", "photographs", "control_points")
"""Keys without which a file is no report of photogram at all."""

_MOST_SHOWN = 40  # characters of a wrong value
_REMEDY = "run photogram adjust again"


def read_report(path: Path) -> Report:
    """Return what report.json holds. Raises ReportError where it cannot be read, is damaged or is something else."""
    try:
        return report_of(read_whole(path, MOST_BYTES))
    except ReportError as error:  # an OSError too
        raise ReportError(f"{path}: {error}: {_REMEDY}") from error
    except OSError as error:
        raise ReportError(f"{path}: cannot be read ({error.strerror}): {_REMEDY}") from error


def report_of(text: bytes | str) -> Report:
    """Return what the text of report.json holds.

    Raises ReportError, in a sentence without the file's name, where it is no JSON, no report of photogram, or damaged.
    """
    try:
        report = report_types().validate_json(text)
    except ValidationError as error:
        raise ReportError(_sentence(text, error)) from error
    contradiction = _contradiction(report)
    if contradiction:
        raise ReportError(f"damaged, {contradiction}")
    return report


def _sentence(text: bytes | str, error: ValidationError) -> str:
    """Return the first error in words."""
    first = error.errors(include_url=False)[0]
    if first["type"] == "json_invalid":
        return f"damaged ({printable(first['ctx']['error'])})"
    content: object = from_json(text)
    if not isinstance(content, dict):
        return "no report of photogram, it is no block of keys"
    absent = next((key for key in NEEDED if key not in content), None)
    if absent is not None:
        return f"no report of photogram, {absent} is not in it"
    place = printable(shortened(_place(first["loc"]), 100))
    if first["type"].startswith("union_tag"):
        return f"damaged, {place}.registered: it must be true or false"
    if first["type"] == "missing":
        return f"damaged, or not of this version of photogram: {place} is not in it"
    reason = first["msg"][:1].lower() + first["msg"][1:]
    return f"damaged, {place}: {reason}, found {printable(shortened(repr(first['input']), _MOST_SHOWN))}"


def _place(location: Sequence[str | int]) -> str:
    """Return where in the file something is wrong, as one writes it: control_points[1].residual_m[0]."""
    # the types that an entry may be of are no keys of the file: by name, or whether a photograph is registered
    parts = [
        part
        for depth, part in enumerate(location)
        if not (str(part).endswith("Record") or (depth == 2 and location[0] == "photographs"))
    ]
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")


def _contradiction(report: Report) -> str:
    """Return where parts of a report contradict each other, empty where they do not."""
    for name, photograph in oriented(report["photographs"]).items():
        if photograph["camera"] not in report["cameras"]:
            return f"photographs.{name}: its camera {photograph['camera']!r} is none of the cameras"
    errors = report["diagnosis"]["ground_errors"]
    if errors is not None:
        counts = {len(errors["position_map_m"]), len(errors["sigma_m"]), len(errors["factor_m"])}
        ranks = {len(row) for factor in errors["factor_m"] for row in factor}
        if len(counts) > 1 or len(ranks) > 1:
            return "diagnosis.ground_errors: its lists are not of one length"
    return ""


@contextmanager
def making_of(path: Path) -> Iterator[None]:
    """Turn whatever the making of a page trips over into a ReportError that names the report ``path``.

    read_report cannot know every figure that a page wants; a page is made of nothing but the report.
    """
    try:
        yield
    except PhotogramError:
        raise
    except (
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        ArithmeticError,
        RecursionError,
        TemplateError,
    ) as error:
        words = printable(shortened(f"{type(error).__name__}: {error}", 200))
        raise ReportError(f"{path}: damaged, or not of this version of photogram ({words}): {_REMEDY}") from error
