"""Rasters of the results that the map draws. The browser reads them itself, in the parts that it shows, from the files
that are handed over."""

from pathlib import Path
from typing import Literal

from typing_extensions import TypedDict

from photogram.files.maps.rasters import open_raster, value_range
from photogram.languages.said import Said
from photogram.result_files import ResultFolder

Kind = Literal["picture", "heights", "sigma"]


class Layer(TypedDict):
    """A raster on the map."""

    name: str
    title: str
    kind: Kind
    file: str
    """Within the folder of results."""
    range: list[float]
    """Values between which its colours run; empty of a picture."""


_LAYERS: tuple[tuple[str, str, Kind, str], ...] = (
    ("orthophoto", Said("Orthophoto"), "picture", f"{ResultFolder.DELIVERABLES}/orthophoto.tif"),
    ("surface", Said("Surface heights"), "heights", f"{ResultFolder.DELIVERABLES}/dsm.tif"),
    ("terrain", Said("Terrain heights"), "heights", f"{ResultFolder.DELIVERABLES}/dtm.tif"),
    ("sigma", Said("Accuracy of heights"), "sigma", f"{ResultFolder.QUALITY}/dsm_sigma.tif"),
    ("plan_sigma", Said("Accuracy in plan"), "sigma", f"{ResultFolder.QUALITY}/orthophoto_sigma.tif"),
)
_RANGE = 0.02, 0.98


def layers(results: Path) -> list[Layer]:
    """Return the layers that there are, the one that is drawn on top first. Raises ProjectError where a raster is
    damaged."""
    return [
        {"name": name, "title": title, "kind": kind, "file": file, "range": _range(results / file, kind)}
        for name, title, kind, file in _LAYERS
        if (results / file).is_file()
    ]


def _range(path: Path, kind: Kind) -> list[float]:
    if kind == "picture":
        return []
    open_raster(path, local=True)  # one that is damaged is named here, and not by the browser
    low, high = value_range(path, *_RANGE)
    return [0.0 if kind == "sigma" else low, max(high, low + 1e-3)]
