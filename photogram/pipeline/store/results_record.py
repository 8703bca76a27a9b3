"""What photogram has written to a folder of results, by name and checksum: nothing else is ever removed from it.

The record is ``checksums.sha256``, which ``sha256sum --check`` reads too.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path

from photogram.files.atomic import observed, replacing
from photogram.files.npz_json import file_fingerprint
from photogram.files.stage_folders import errors_of

CHECKSUMS = "checksums.sha256"
_PLACES = (Path("."), Path("pictures"), Path("masks"))
PRODUCTS = (
    "report.json",
    "report.schema.json",
    "report.html",
    "photographs.csv",
    "photographs.csvt",
    "photographs.prj",
    "photographs.geojson",
    "footprints.geojson",
    "points_*.txt",
    "points_*.laz",
    "tie_points*.npz",
    "tie_points.mat",
    "dsm.tif",
    "dsm_*.tif",
    "dsm_source.tif.aux.xml",
    "dtm.tif",
    "dtm_sigma.tif",
    "dtm_source.tif",
    "dtm_source.tif.aux.xml",
    "dense.laz",
    "contours.gpkg",
    "orthophoto.tif",
    "orthophoto_bands.tif",
    "orthophoto_sigma.tif",
    "orthophoto_source.tif",
    "orthophoto_source.tif.aux.xml",
    "outline.gpkg",
    "plane.json",
    "masks/*.png",
    "pictures/surface.png",
    "pictures/plan.png",
    "pictures/comparison.png",
    "pictures/orthophoto.png",
    "pictures/dense_*.png",
    "pictures/residuals_*.png",
    "pictures/matches_*.png",
)
"""Patterns of the names that a run writes to a folder of results."""

FOREIGN = "not written by photogram, and would be overwritten"
FOREIGN_REMEDY = "move such files elsewhere, or give another folder under results"

_LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def read_record(results: Path) -> dict[str, str]:
    """Return the SHA-256, in hex, of what photogram has written to a folder of results, by name; lines that are damaged
    are left out. Raises WorkspaceError where the record cannot be read."""
    path = results / CHECKSUMS
    if not path.is_file():
        return {}
    with errors_of(path, "cannot be read"):
        text = path.read_text(encoding="utf-8", errors="replace")
    matches = (_LINE.fullmatch(line) for line in text.splitlines())
    return {match[2]: match[1] for match in matches if match}


def foreign_products(results: Path) -> list[str]:
    """Return the names of files in a folder of results that a run would overwrite and that photogram has not written.
    Raises WorkspaceError where the record cannot be read."""
    known = read_record(results)
    there = [path.relative_to(results).as_posix() for place in _PLACES for path in (results / place).glob("*")]
    return sorted(n for n in there if n not in known and any(fnmatchcase(n, product) for product in PRODUCTS))


def _write_record(results: Path, files: dict[str, str]) -> None:
    with replacing(results / CHECKSUMS) as temporary:
        temporary.write_text("".join(f"{files[name]}  {name}\n" for name in sorted(files)), encoding="utf-8")


@contextmanager
def recorded(results: Path) -> Iterator[None]:
    """Record every result and every picture that is written to a folder of results while the block runs, each file
    before it is there; other folders in it may be anything, that of the intermediate results among them."""
    files = read_record(results)

    def note(temporary: Path, path: Path) -> None:
        name = path.relative_to(results)
        if name.parent in _PLACES and name.name != CHECKSUMS:
            files[name.as_posix()] = file_fingerprint(temporary)
            _write_record(results, files)

    with observed(results, note):
        yield


def remove_made(results: Path, names: Iterable[str]) -> list[str]:
    """Remove files from a folder of results that photogram has written there and nobody has changed since; return
    their names. Raises WorkspaceError where one cannot be removed."""
    files, removed = read_record(results), []
    for name in names:
        path = results / name
        known = files.pop(name, None)
        links = path.is_symlink() or (path.parent.is_symlink() and path.parent != results)
        own = known is not None and Path(name).parent in _PLACES and not links
        if own and path.is_file() and file_fingerprint(path) == known:
            with errors_of(path, "cannot be removed"):
                path.unlink()
            removed.append(name)
    _write_record(results, files)
    return removed


def remove_outdated(results: Path, products: Iterable[str]) -> list[str]:
    """Remove what photogram has written to a folder of results but for ``products``, as ``remove_made``."""
    return remove_made(results, sorted(read_record(results).keys() - set(products)))
