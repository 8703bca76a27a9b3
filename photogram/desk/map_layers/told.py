"""What a comparison says on the page: figures, sentences, how a terminal does the same, and what lies beside."""

import shlex
from pathlib import Path

from typing_extensions import TypedDict

from photogram.change.files.change_files import SurfaceChange
from photogram.change.sentences import sentences_of, volume_sentences
from photogram.change.surface_change import SurfaceRequest
from photogram.desk.map_layers.asked import Asked, meaning_of
from photogram.desk.map_layers.layers import Layer, layers
from photogram.desk.measurements import Figure
from photogram.errors import PhotogramError
from photogram.files.maps.rasters import open_raster, value_range
from photogram.geodesy.crs import map_units
from photogram.languages.said import Figures, Said
from photogram.measures.round_lengths import round_up
from photogram.volumes.surfaces import SURFACE_SUFFIXES, StatedSigma
from photogram.volumes.volumes import Volume
from photogram.wording import percent

SIDE_BY_SIDE = ("orthophoto", "surface", "terrain")
"""Layers of another survey that are laid beside this one's."""

_RANGE = 0.02, 0.98


class VolumeView(TypedDict):
    """Cut and fill within an outline."""

    name: str
    figures: list[Figure]


class Told(TypedDict):
    """What a comparison says."""

    said: list[str]
    volumes: list[VolumeView]
    within: str
    """Share of the cells within the level of detection."""
    has_untold: bool
    """Whether there are cells without one, filled or interpolated."""
    half_range: float
    """Differences to both sides of 0 between which the colours run, in the unit of the raster."""
    unit: str
    """Its symbol."""


def told_of(change: SurfaceChange, asked: Asked, difference: Path) -> Told:
    """Return what a comparison says; ``difference`` is its raster. Raises ProjectError where that is damaged."""
    low, high = value_range(difference, *_RANGE)
    compared = max(change.within_level + change.lowered + change.raised, 1)
    sigma = f"of {change.later}: {change.sigma_from}; of {change.reference}: {change.reference_sigma_from}"
    return {
        "said": [
            *meaning_of(asked, change.later, change.reference),
            f"Standard deviations {sigma}.",
            *sentences_of(change, "choose what is taken off"),
            *volume_sentences(change),
        ],
        "volumes": [_volume(volume) for volume in (*change.volumes, *_sum(change))],
        "within": percent(change.within_level / compared, 1),
        "has_untold": change.interpolated_cells > 0,
        "half_range": round_up(max(abs(low), abs(high), 1e-3)),
        "unit": map_units(open_raster(difference, local=True).crs).height_symbol,
    }


def _sum(change: SurfaceChange) -> tuple[Volume, ...]:
    return (change.total,) if change.total is not None and len(change.volumes) > 1 else ()


def _volume(volume: Volume) -> VolumeView:
    figures: list[Figure] = [
        {"name": Said("fill"), "value": volume.fill_m3, "sigma": volume.fill_sigma_m3, "unit": "m³"},
        {"name": Said("cut"), "value": volume.cut_m3, "sigma": volume.cut_sigma_m3, "unit": "m³"},
        {"name": Said("net"), "value": volume.net_m3, "sigma": volume.net_sigma_m3, "unit": "m³"},
        {"name": Said("area in plan"), "value": volume.area_m2, "sigma": None, "unit": "m²"},
    ]
    parts = {
        Said("of it filled"): volume.interpolated_m2,
        Said("of it without heights"): volume.unmeasured_m2,
    }
    figures += [{"name": name, "value": m2, "sigma": None, "unit": "m²"} for name, m2 in parts.items() if m2 > 0.0]
    return {"name": volume.name, "figures": figures}


def in_words(told: Told) -> Told:
    """Return what a comparison says as it is read from its file, with the names of its figures as messages."""
    volumes: list[VolumeView] = [
        {"name": volume["name"], "figures": [{**f, "name": Said(f["name"])} for f in volume["figures"]]}
        for volume in told["volumes"]
    ]
    return {**told, "volumes": volumes, "within": Figures(told["within"])}


def command_of(request: SurfaceRequest, output: Path) -> str:
    """Return what does the same in a terminal."""
    words = ["photogram", "compare", str(request.later), "--reference", str(request.earlier)]
    for option, path in (("--polygons", request.polygons), ("--stable", request.stable)):
        words += [] if path is None else [option, str(path)]
    words += [] if request.coregister is None else ["--coregister", request.coregister]
    words += [*_sigma("--sigma", request.sigma), *_sigma("--reference-sigma", request.earlier_sigma)]
    words += [] if request.correlation_m is None else ["--correlation", f"{request.correlation_m:g}"]
    words += [word for part in request.parts for word in ("--part", part)]
    return shlex.join([*words, "--output", str(output)])


def _sigma(option: str, stated: StatedSigma | None) -> list[str]:
    return [] if stated is None else [option, f"{stated.own_m:g}", f"{stated.common_m:g}"]


def other_layers(asked: Asked) -> list[tuple[Layer, Path]]:
    """Return the rasters of the other survey that can be laid beside this one's, with their files; none of a
    triangulation, nor where they are gone or damaged."""
    path = Path(asked["path"].strip()).expanduser()
    try:
        if path.is_dir():
            results = path / "results" if (path / "results").is_dir() else path
            return [(layer, results / layer["file"]) for layer in layers(results) if layer["name"] in SIDE_BY_SIDE]
        if path.suffix.lower() in SURFACE_SUFFIXES and path.is_file():
            low, high = value_range(path, *_RANGE)
            shown = [low, max(high, low + 1e-3)]
            own: Layer = {"name": "surface", "title": path.name, "kind": "heights", "file": path.name, "range": shown}
            return [(own, path)]
    except PhotogramError:
        return []  # comparing says what is wrong with them
    return []
