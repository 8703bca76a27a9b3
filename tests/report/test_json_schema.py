"""report.json against its types and its JSON Schema, and both against the page that documents its keys."""

import json
import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, NotRequired, Union, get_args, get_origin, get_type_hints

import pytest
from jsonschema import Draft202012Validator
from typing_extensions import is_typeddict

from photogram.cli.work.schema import SCHEMAS
from photogram.errors import ReportError
from photogram.report.reading import report_of
from photogram.report.record.json_schema import report_schema
from photogram.report.record.report import Report

ROOT = Path(__file__).parents[2]
Json = dict[str, Any]


@pytest.fixture(scope="module")
def validator() -> Draft202012Validator:
    return Draft202012Validator(report_schema())


@pytest.fixture(scope="module")
def report(finished_survey: Path) -> Json:
    return dict(json.loads((finished_survey / "results/quality/report.json").read_text(encoding="utf-8")))


def test_the_schema_is_one() -> None:
    Draft202012Validator.check_schema(report_schema())


def test_reports_follow_the_schema_and_are_read_as_they_are(
    report: Json, full_report: Json, validator: Draft202012Validator
) -> None:
    for whole in (report, json.loads(json.dumps(full_report))):
        assert list(validator.iter_errors(whole)) == []
        assert report_of(json.dumps(whole)) == whole


def test_the_command_prints_what_lies_beside_the_results(finished_survey: Path, photogram: Callable[..., Any]) -> None:
    said = photogram("schema", "report")
    assert said.code == 0
    beside = json.loads((finished_survey / "results/quality/report.schema.json").read_text(encoding="utf-8"))
    assert json.loads(said.out) == beside == report_schema() == SCHEMAS["report"]()


def test_a_key_of_a_later_version_does_no_harm(report: Json, validator: Draft202012Validator) -> None:
    later = {**report, "atmosphere": {"pressure_hpa": 1013.0}}
    assert validator.is_valid(later)
    assert report_of(json.dumps(later)) == report


def test_a_report_without_the_work_of_decisions_is_read(report: Json, validator: Draft202012Validator) -> None:
    earlier = deepcopy(report)
    del earlier["adjustment"]["effort"]
    assert validator.is_valid(earlier)
    assert report_of(json.dumps(earlier)) == earlier
    damaged = deepcopy(report)
    damaged["adjustment"]["effort"][0]["solutions"] = -1
    assert not validator.is_valid(damaged)


# ---- what is no report ---------------------------------------------------------------------------------------------


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place of a report, of lists only the first entry."""
    yield path
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from places(entry, (*path, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*path, 0))


def thinned(value: Any) -> Any:
    """A report with two entries of every list and of every mapping of photographs, at most."""
    if isinstance(value, list):
        return [thinned(v) for v in (value if len(value) == 3 else value[:2])]
    if isinstance(value, dict):
        return {k: thinned(v) for k, v in list(value.items())[: 2 if "sim_0001.JPG" in value else None]}
    return value


def test_a_value_of_another_kind_is_refused_everywhere(report: Json, validator: Draft202012Validator) -> None:
    """Whatever stands where another kind belongs is refused by the reader; of some places the schema is asked too."""
    small, checked = thinned(report), 0
    for path in places(small):
        if not path:
            continue
        spoilt = deepcopy(small)
        part = spoilt
        for key in path[:-1]:
            part = part[key]
        part[path[-1]] = [[{}]]
        with pytest.raises(ReportError, match="damaged"):
            report_of(json.dumps(spoilt))
        if checked % 40 == 0:
            assert not validator.is_valid(spoilt), path
        checked += 1
    assert checked > 400


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("control_points", 0, "role"), "checks"),
        (("control_points", 0, "surveyed_map_m"), [1.0, 2.0]),
        (("control_points", 0, "surveyed_map_m"), [1.0, 2.0, None]),
        (("block", "overlap", "share_3_or_more"), 1.1),
        (("block", "registered"), -1),
        (("block", "registered"), 3.5),
        (("adjustment", "converged"), 1),
        (("cameras", "simulated", "focal_px"), 0.0),
        (("cameras", "simulated", "model"), "pinhole"),
        (("heights", "output"), "barometric"),
        (("verdict", "grade"), "excellent"),
        (("photographs", "sim_0001.JPG", "registered"), "yes"),
        (("photographs", "sim_0001.JPG", "registered"), False),
        (("photographs", "sim_0001.JPG", "position_map_m"), [1e12, 0.0, 0.0]),
        (("diagnosis", "dome", "radius_m"), 1e300),
    ],
)
def test_wrong_values_are_refused(
    report: Json, validator: Draft202012Validator, path: tuple[str | int, ...], value: object
) -> None:
    spoilt = deepcopy(report)
    part: Any = spoilt
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    assert not validator.is_valid(spoilt)
    with pytest.raises(ReportError, match="damaged"):
        report_of(json.dumps(spoilt))


def test_no_key_but_the_optional_may_be_absent(report: Json, validator: Draft202012Validator) -> None:
    optional = {"dense", "orthophoto", "estimated_sigmas", "marks", "standard"}
    for key in report:
        without = {k: v for k, v in report.items() if k != key}
        assert validator.is_valid(without) == (key in optional), key


# ---- the page that documents the keys ------------------------------------------------------------------------------


def alternatives(hint: Any) -> list[Any]:
    """The types that a hint stands for, without notes on it, None, and the list or the mapping around them."""
    origin = get_origin(hint)
    if origin in (NotRequired,):
        return alternatives(get_args(hint)[0])
    if origin in (Union, UnionType):
        return [a for part in get_args(hint) if part is not NoneType for a in alternatives(part)]
    if origin is list:
        return alternatives(get_args(hint)[0])
    if origin is dict:
        return alternatives(get_args(hint)[1])
    return [hint]


def keys_of(kinds: list[Any]) -> dict[str, list[Any]]:
    """The keys of types, and the types of what stands under each."""
    found: dict[str, list[Any]] = {}
    for kind in kinds:
        if is_typeddict(kind):
            for key, hint in get_type_hints(kind).items():
                found.setdefault(key, []).extend(alternatives(hint))
    return found


def below(path: str) -> list[Any] | None:
    """The types under a dotted path of report.json, None where there is no such key."""
    kinds: list[Any] = [Report]
    for part in path.replace("[]", "").split("."):
        if part.startswith("<"):
            continue  # a name that a survey gives
        keys = keys_of(kinds)
        if part not in keys:
            return None
        kinds = keys[part]
    return kinds


def every_key(kinds: list[Any], path: str = "") -> Iterator[tuple[str, str, str]]:
    """Every key of the types with the types and the path that it stands in."""
    names = " ".join(sorted(kind.__name__ for kind in kinds if is_typeddict(kind)))
    for key, under in keys_of(kinds).items():
        yield names, path, key
        yield from every_key(under, f"{path}.{key}".removeprefix("."))


def documented() -> dict[str, str]:
    """The page by its headings that name a part of the file; what follows under other headings belongs to it."""
    parts: dict[str, str] = {}
    title = ""
    for block in re.split(r"(?m)^(?=#{2,3} )", (ROOT / "docs/report.md").read_text(encoding="utf-8")):
        heading = re.sub(r"^#+ |\\", "", block.partition("\n")[0])
        title = "" if heading == "Top level" else heading if below(heading) is not None else title
        parts[title] = parts.get(title, "") + block
    return parts


def rows(text: str) -> Iterator[str]:
    """The first cells of the tables of keys."""
    for table in re.split(r"\n\n", text):
        lines = [line for line in table.splitlines() if line.startswith("| ")]
        if lines and lines[0].startswith("| key |"):
            yield from (line.split(" | ")[0] for line in lines[1:])


def test_every_key_on_the_page_is_in_the_file() -> None:
    checked = 0
    for title, text in documented().items():
        for cell in rows(text):
            former = ""
            for said in re.findall(r"`([^`]+)`", cell):
                name = f"{former.rpartition('.')[0]}{said}" if said.startswith(".") else said
                former = name
                inside = [title, *SUBTABLES.get(title, ())]
                assert any(below(f"{part}.{name}".removeprefix(".")) is not None for part in inside), (title, name)
                checked += 1
    assert checked > 200


SUBTABLES = {"gnss": ("gnss.flights.<flight>",), "control_points[]": ("blunders",), "blunders": ("blunders_effect",)}
"""Parts that have a table under the heading of another."""


def test_every_key_of_the_file_is_on_the_page() -> None:
    page = {re.sub(r"\[\]|\.<\w+>", "", title): text for title, text in documented().items()}
    paths: dict[tuple[str, str], list[str]] = {}  # a type may stand in several places, and is described in one
    for kinds, path, key in every_key([Report]):
        paths.setdefault((kinds, key), []).append(path)
    absent = []
    for (kinds, key), places_of_it in paths.items():
        described = [t for t in page if any(path.startswith(t) for path in places_of_it)]
        if described == [""] and places_of_it != [""]:
            described = list(page)  # a small part, told of where it belongs
        words = {w for t in described for said in re.findall(r"`([^`\n]+)`", page[t]) for w in re.split(r"\W+", said)}
        if key not in words:
            absent.append(f"{kinds}.{key}")
    assert absent == []
