"""What a person asks to be compared on the page, and the request that `photogram.change` takes."""

from pathlib import Path
from typing import Literal

from typing_extensions import TypedDict

from photogram.change.surface_change import SurfaceRequest
from photogram.errors import ProjectError, SettingError
from photogram.files.triangulations.reading import READERS
from photogram.languages.said import Said
from photogram.result_files import result_path
from photogram.volumes.stable_ground import Motion
from photogram.volumes.surfaces import StatedSigma, in_survey, surface_path

With = Literal["design", "earlier", "later"]
Own = Literal["surface", "terrain"]
Taken = Literal["offset", "tilt"]

OWN_FILES: dict[Own, str] = {"surface": "dsm.tif", "terrain": "dtm.tif"}
EXACT = StatedSigma(0.0, 0.0)


class Asked(TypedDict):
    """What is to be compared."""

    path: str
    """The other surface: a GeoTIFF, LandXML, DXF, or the folder of a survey."""
    relation: With
    """A design, or a survey before or after this one."""
    own: Own
    """Which surface of this survey, and of the other where that is the folder of one."""
    parts: list[str]
    """Surfaces of a LandXML file, or layers of a drawing; none: the only one."""
    sigma_m: list[float] | None
    """Standard deviations of the other surface, own and common; None: as its files say. A design has none."""
    correlation_m: float | None
    """Width over which own errors correlate; None: that of the windows of the matching."""
    outlines: list[int]
    """Numbers of kept measurements that volumes are asked for; none: all that both cover."""
    stable: list[int]
    """Those that have not moved."""
    taken_off: Taken | None
    """What is taken off on them."""


def checked(asked: Asked) -> Path:
    """Return the other surface. Raises SettingError or ProjectError where it cannot be one."""
    if not asked["path"].strip():
        raise SettingError("path", Said("choose a file or a folder to compare with"))
    path = Path(asked["path"].strip()).expanduser().absolute()
    if not path.exists():
        raise ProjectError(Said("{path}: not found: check its path", path=path))
    if path.is_dir() and not surface_path(path).is_file():
        raise ProjectError(
            Said("{path}: no surface among its results: choose a survey whose run has finished, or a file", path=path)
        )
    if path.is_dir() and asked["relation"] == "design":
        raise SettingError("relation", Said("the folder of a survey is no design: say whether it is earlier or later"))
    if asked["relation"] == "design" and (asked["stable"] or asked["taken_off"] or asked["sigma_m"]):
        raise SettingError("relation", Said("a design has no errors and no stable ground: leave both out"))
    if asked["taken_off"] is not None and not asked["stable"]:
        raise SettingError("stable", Said("choose the outlines of ground that has not moved"))
    if path.suffix.lower() in READERS and asked["relation"] != "design" and asked["sigma_m"] is None:
        raise SettingError(
            "sigma_m", Said("{file} says nothing of its errors: state two standard deviations", file=path.name)
        )
    return path


def request_of(asked: Asked, results: Path, polygons: Path | None, stable: Path | None) -> SurfaceRequest:
    """Return the request, with the files of the outlines. Raises as ``checked``, and ProjectError where this survey has
    no such surface."""
    other, own = checked(asked), result_path(results, OWN_FILES[asked["own"]])
    if not own.is_file():
        raise ProjectError(
            Said("{file}: the results have none: run the survey first, or choose another surface", file=own.name)
        )
    if other.is_dir():
        other = in_survey(other, OWN_FILES[asked["own"]])
        if not other.is_file():
            raise ProjectError(
                Said("{path}: that survey has no terrain: compare the surfaces, or make its terrain", path=other)
                if asked["own"] == "terrain"
                else Said("{path}: that survey has no surface: compare the terrains, or make its surface", path=other)
            )
    is_design = asked["relation"] == "design"
    stated = EXACT if is_design else None if asked["sigma_m"] is None else StatedSigma(*asked["sigma_m"])
    other_is_later = asked["relation"] != "earlier"
    motion: Motion | None = asked["taken_off"]
    return SurfaceRequest(
        later=other if other_is_later else own,
        earlier=own if other_is_later else other,
        polygons=polygons,
        stable=stable,
        coregister=motion,
        sigma=stated if other_is_later else None,
        earlier_sigma=None if other_is_later else stated,
        correlation_m=asked["correlation_m"],
        parts=tuple(asked["parts"]),
    )


def meaning_of(asked: Asked, change_later: str, change_earlier: str) -> list[str]:
    """Return what the signs of a comparison mean, and what its standard deviations hold of errors in common."""
    said = [f"{change_later} minus {change_earlier}."]
    if asked["relation"] == "design":
        return [*said, "Fill is what is still to be placed, cut what is still to be dug. The design counts as exact."]
    said.append("Fill is ground that has risen, cut ground that has sunk.")
    said.append(
        "Both count as independent. What both share, by common control points for example, is not taken off: "
        "differences are then better than stated."
    )
    if not asked["stable"]:
        said.append(
            "What each survey has in common to all its heights, a shift or a tilt, is in the differences and in their "
            "standard deviations: outlines of ground that has not moved show it, and take it off where you ask for it."
        )
    return said
