"""A report compared with what follows from its observations, line by line, and the checksums of its files."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from os.path import isfile  # false, not an exception, for a name that cannot be
from pathlib import Path
from typing import Any, Literal

import numpy as np

from photogram.verification.equations import Arrays
from photogram.verification.figures import Derived, Figures
from photogram.verification.solution import solved

Outcome = Literal["equal", "differs", "cannot be told"]
RELATIVE, FORMAT, LEAST_STEP, MOVED_M = 1e-8, 1, 0.05, 1e-7
FLOORS = {"residual_m": 2e-8, "mean_m": 2e-8, "rmse": 2e-8, "sigma": 1e-11, "_map_m": 1e-6, "_deg": 1e-8, "_m": 2e-8}
"""What is rounding, in the unit of a figure, by what is in its key: a double holds a northing to 1e-9 m."""
LEAST, OF_CHECKS = 1e-9, 1e-6
"""Of any other figure, and of those that divide differences at check points by their standard deviations."""
LARGEST = 1e300
"""Of a number: a whole one of JSON may be longer than any double."""
VOLATILE = frozenset({"seconds", "peak_memory_bytes", "processed", "report_id"})
REASONS = {
    "seconds": "times are measured, not derived", "peak_memory_bytes": "memory is measured, not derived",
    "clouds": "point clouds are not read", "dsm": "rasters are not read", "dense": "rasters are not read",
    "orthophoto": "rasters are not read", "volumes": "rasters are not read", "plane": "rasters are not read",
    "deliverables": "sizes of files; their checksums are compared",
}  # fmt: skip
NAMED = {
    *("photographs", "cameras", "diagnosis.cameras", "adjustment.gnss_offsets"),
    *("control_points", "control_points.*.marks"),
}
NOT_DERIVED = "not derived by this version"


@dataclass(frozen=True)
class Line:
    """What is said of one thing: what it is, and both figures and their difference, or why nothing can be told."""

    outcome: Outcome
    what: str
    words: str


@dataclass
class Comparison:
    """Figures of a report against derived ones, to ``relative`` of themselves: ``equal`` and ``open`` ones by their
    place, and what ``differs``."""

    relative: float = RELATIVE
    equal: dict[str, list[float]] = field(default_factory=dict)
    open: dict[str, int] = field(default_factory=dict)
    differs: list[Line] = field(default_factory=list)

    def compare(self, stated: Any, derived: Any, path: str, place: str) -> None:  # noqa: ANN401 - JSON at any depth
        """Compare two values of JSON; ``path`` names them, ``place`` all that are alike."""
        if isinstance(stated, dict) and isinstance(derived, dict):
            for key in stated.keys() & derived.keys() | (derived.keys() - stated.keys()):
                self.compare(stated.get(key), derived[key], f"{path}.{key}".lstrip("."), inner(place, key))
            for key in stated.keys() - derived.keys():
                self.leave(stated[key], inner(place, key))
        elif isinstance(stated, list) and isinstance(derived, list) and len(stated) == len(derived):
            for n, (one, other) in enumerate(zip(stated, derived, strict=True)):
                self.compare(one, other, f"{path}[{n}]", place)
        elif is_number(stated) and is_number(derived):
            off, key = abs(stated - derived), place.rpartition(".")[2]
            size = 1.0 if "redundancy" in key else 0.0 if key.endswith("_map_m") else max(abs(stated), abs(derived))
            floor = next((value for part, value in FLOORS.items() if part in key), LEAST)
            of_checks = key in ("z", "mahalanobis") or place.startswith("predicted_against_achieved")
            if off <= self.relative * size + (OF_CHECKS if of_checks else floor):
                self.equal.setdefault(place, []).append(off)
            else:
                words = f"stated {stated!r}, derived {derived!r}, by {off:.3g}"
                self.differs.append(Line("differs", path, words))
        elif stated == derived:
            self.equal.setdefault(place, []).extend([0.0] * isinstance(stated, bool | str))
        else:
            self.differs.append(Line("differs", path, f"stated {short(stated)}, derived {short(derived)}"))

    def leave(self, stated: Any, place: str) -> None:  # noqa: ANN401 - JSON at any depth
        """Count the figures of what is not derived."""
        if isinstance(stated, dict | list):
            for key, value in stated.items() if isinstance(stated, dict) else enumerate(stated):
                self.leave(value, inner(place, key) if isinstance(key, str) else place)
        elif is_number(stated):
            self.open[place] = self.open.get(place, 0) + 1


def is_number(value: object) -> bool:
    """Return whether a value of JSON is a number that can be told from another: a whole one may be of any length."""
    return isinstance(value, int | float) and not isinstance(value, bool) and not abs(value) > LARGEST


def short(value: object) -> str:
    """Return a value in a few words."""
    return brief(json.dumps(value, ensure_ascii=False), 60)


def brief(text: str, length: int = 200) -> str:
    """Return a text of a file, or its beginning."""
    return text if len(text) < length else f"{text[: length - 3]}..."


def inner(place: str, key: str) -> str:
    """Return the place of a key; names of photographs, cameras, flights and points are all one."""
    return f"{place}.*" if place in NAMED else f"{place}.{key}".lstrip(".")


def by_name(stated: Figures) -> Figures:
    """Return a report whose lists of ground points and marks are under their names."""
    points = {p["name"]: {**p, "marks": {m["photograph"]: m for m in p["marks"]}} for p in stated["control_points"]}
    return {**stated, "control_points": points}


def report_id(report: Mapping[str, Any]) -> str:
    """Return 16 digits of the SHA-256 of a report without times, memory and date, keys sorted, nothing between."""

    def content(value: Any) -> Any:  # noqa: ANN401 - JSON at any depth
        if isinstance(value, dict):
            return {key: content(v) for key, v in value.items() if key not in VOLATILE}
        return [content(v) for v in value] if isinstance(value, list) else value

    text = json.dumps(content(report), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]


def checksums(results: Path, report: Mapping[str, Any]) -> Iterator[Line]:
    """Yield what is to be said of the files that report.json and the lists of checksums name."""
    stated = {f["file"]: (f["sha256"], "report.json") for f in report["deliverables"]}
    for record in sorted(results.glob("**/checksums.sha256")):
        for digest, name in re.findall(r"^([0-9a-f]{64})  (.+)$", record.read_text(encoding="utf-8"), re.MULTILINE):
            place = record.parent.relative_to(results) / name
            stated.setdefault(place.as_posix(), (digest, record.relative_to(results).as_posix()))
    for name, (digest, source) in sorted(stated.items()):
        path, what = results / name, f"SHA-256 of {brief(name)}"
        if not isfile(path) or not path.resolve().is_relative_to(results.resolve()):
            yield untold(what, "the file is not there")
            continue
        with path.open("rb") as stream:
            found = hashlib.file_digest(stream, "sha256").hexdigest()
        words = f"{source}: {str(digest)[:16]}..." + ("" if found == digest else f", the file: {found[:16]}...")
        yield judged(found == digest, what, words)
    own, found = str(report["report_id"]), report_id(report)
    yield judged(own == found, "report_id", f"stated {brief(own)}, of its content {found}")


def judged(holds: bool, what: str, words: str) -> Line:
    """Return a line on something that holds, or does not."""
    return Line("equal" if holds else "differs", what, words)


def untold(what: str, words: str) -> Line:
    """Return a line on something that cannot be told."""
    return Line("cannot be told", what, words)


def read_observations(path: Path) -> Arrays:
    """Return the arrays of observations.npz. Raises ValueError where it cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        if int(arrays["format"]) != FORMAT:
            raise ValueError(f"not of format {FORMAT}")
    # of a damaged header NumPy raises whatever it trips over: SyntaxError, TokenError, OverflowError and more
    except Exception as error:
        raise ValueError(f"{path}: cannot be read ({brief(str(error))})") from error
    return arrays


@dataclass(frozen=True)
class VerifiedReport:
    """What is said of a report."""

    lines: tuple[Line, ...]
    """What is said, line by line."""
    derived: int
    """Figures of report.json that were derived."""
    figures: int
    """All figures of report.json."""

    @property
    def holds(self) -> bool:
        """Return whether nothing differs."""
        return all(line.outcome != "differs" for line in self.lines)


@np.errstate(all="ignore")  # of numbers that somebody changed anything may come
def derived_lines(a: Arrays, report: Figures) -> tuple[list[Line], Comparison]:
    """Return what is to be said of the figures of a report."""
    comparison = Comparison()
    if len(a["not_held"]):
        comparison.leave(report, "")
        words = f"its model has what the file does not hold: {', '.join(a['not_held'].tolist())}"
        return [untold("adjustment", words)], comparison
    try:
        s = solved(a)
        derived = Derived(s)
        figures, comparison.relative = derived.all(), max(RELATIVE, s.precision)
    except (ValueError, LookupError, ArithmeticError, TypeError) as error:
        comparison.leave(report, "")
        return [judged(False, "adjustment", f"nothing follows from the observations: {brief(str(error))}")], comparison
    left = float(max(s.step.max(initial=0.0), s.normal.left.max(initial=0.0)))
    weights = float(np.abs(s.normal.weight - a["tie_robust_weight"]).max(initial=0.0))
    moved = float(np.abs(np.nan_to_num(s.ground_world_m - a["ground_world_m"])).max(initial=0.0))
    words = f"the least squares would move them by {left:.2g} of a standard deviation at most"
    lines = [
        judged(left < LEAST_STEP, "estimates", words),
        judged(weights < RELATIVE, "robust weights", f"largest difference {weights:.2g}"),
        judged(moved < MOVED_M, "check points intersected again", f"largest difference {moved:.2g} m"),
    ]
    if s.precision > RELATIVE:
        words = f"the normal equations are weak, figures are compared to {s.precision:.1g} of themselves"
        lines.append(untold("further digits", words))
    if not (derived.is_grid or derived.is_projected):
        lines.append(untold("map projection", f"{a['map_projection']} is not known here: coordinates are the file's"))
    if a["ground_model_error_m2"].any():
        lines.append(untold("error of the camera model", "its part of the sigmas of heights is the file's"))
    if derived.has_geoid:
        lines.append(untold("geoid heights", "they are the file's"))
    comparison.compare(by_name(report), figures, "", "")
    return lines, comparison


def verify_report(results: Path | str) -> VerifiedReport:
    """Derive the report in a folder of results, or report.json itself, again from observations.npz, and compare the
    files of the results with their checksums. Raises ValueError, with the file, where one cannot be read."""
    path = Path(results)
    report_path = path / "quality" / "report.json" if path.is_dir() else path
    try:
        report: Figures = json.loads(report_path.read_text(encoding="utf-8"))
        files = list(checksums(report_path.parent.parent, report))
        by_name(report)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{report_path}: no report of photogram, or damaged ({brief(str(error))})") from error
    arrays = read_observations(report_path.parent.parent / "technical" / "observations.npz")
    lines, comparison = derived_lines(arrays, report)
    for place, offs in sorted(comparison.equal.items()):
        if offs:
            lines.append(Line("equal", place, f"{len(offs)} figures, largest difference {max(offs):.2g}"))
    lines += sorted(comparison.differs, key=lambda line: line.what)
    told, sections = {place.split(".")[0] for place in comparison.equal}, dict[str, int]()
    for place, count in sorted(comparison.open.items()):
        section = place if place.split(".")[0] in told else place.split(".")[0]
        sections[section] = sections.get(section, 0) + count
    for place, count in sections.items():
        lines.append(untold(place, f"{count} figures: {REASONS.get(place.split('.')[0], NOT_DERIVED)}"))
    derived = sum(map(len, comparison.equal.values())) + len(comparison.differs)
    return VerifiedReport((*lines, *files), derived, derived + sum(comparison.open.values()))
