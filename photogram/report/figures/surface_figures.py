"""The figures of the dense surface: each drawn once, for the report page and as a picture beside it."""

import base64
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from photogram.languages.language import ENGLISH, Language
from photogram.report.figures.page_figures import PLAN_IN, WIDTH_IN, PageFigure, embedded
from photogram.report.figures.profile_figure import profile_figure, sigma_histogram_figure
from photogram.report.figures.profiles import Profile, surface_profiles
from photogram.report.figures.style import data_uri, relabel_plane, save_picture
from photogram.report.figures.surface_maps import (
    orthophoto_figure,
    rays_figure,
    relief_figure,
    sigma_figure,
    target_shares,
)
from photogram.report.numbers.dense_surface import DenseSurface, GroundMarks, OrthophotoPicture
from photogram.report.record.surfaces import DenseRecord, SigmaRecord
from photogram.wording import percent

GROUND_RGB = (0xD4, 0xD4, 0xD4)
JPEG_QUALITY = 88
SVG_PICTURE = re.compile(rb"data:image/png;base64,([^\"]*)")


@dataclass(frozen=True, eq=False)
class DrawnFigure:
    """A figure, its key on the page, caption, and what stands for it where it is not seen; ``tones`` tells that it is a
    picture of many tones, which JPEG holds in a quarter of the bytes; its labels and ``alternative`` are in a
    ``language``."""

    key: str
    figure: Figure
    caption: str
    alternative: str
    tones: bool = False
    language: Language = ENGLISH

    @property
    def file_name(self) -> str:
        """Return what its picture is called in the folder of pictures."""
        return f"{self.key.replace(' ', '_')}.png"


def drawn_surface(
    dense: DenseSurface,
    ground: GroundMarks,
    numbers: DenseRecord,
    target_rmse_v_m: float | None = None,
    datum_sigma_m: float | None = None,
    language: Language = ENGLISH,
) -> list[DrawnFigure]:
    """Draw all figures of a dense surface, the relief in a language; ``numbers`` is what `dense_numbers` made of the
    same.

    ``target_rmse_v_m`` is what the project asks of heights, None where it asks nothing; ``datum_sigma_m`` the datum's
    standard deviation in height where the sigmas of ``dense`` are relative, None where they contain it.
    """
    drawn = [_relief(dense, ground, numbers, language)]
    sigma = numbers["sigma_m"]
    if sigma is not None:
        drawn += [_sigma(dense, sigma, target_rmse_v_m, datum_sigma_m), _rays(dense, numbers)]
        drawn.append(_histogram(dense, numbers, target_rmse_v_m))
    profiles = surface_profiles(dense, ground)
    if profiles:
        drawn.append(_profiles(dense, profiles, datum_sigma_m))
    return drawn


def on_plane(drawn: DrawnFigure) -> DrawnFigure:
    """Return a figure of a surface whose heights count from a plane that is not level, with the words for that."""
    relabel_plane(drawn.figure, drawn.language)
    caption = drawn.caption.replace("lit from the north-west", "lit from the upper left")
    on_it = "On the plane, as the photographs see it; heights are distances in front of it."
    return replace(drawn, caption=f"{caption} {on_it}")


def surface_figures(drawn: Sequence[DrawnFigure]) -> list[PageFigure]:
    """Return drawn figures as those of the report page."""
    return [PageFigure(d.key, d.caption, d.alternative, _uri(d), d.language.code) for d in drawn]


def write_surface_pictures(folder: Path, drawn: Sequence[DrawnFigure]) -> list[str]:
    """Write drawn figures as PNG into a folder; returns their names. Raises WorkspaceError when one cannot be
    written."""
    for figure in drawn:
        save_picture(figure.figure, folder / figure.file_name)
    return [figure.file_name for figure in drawn]


def _uri(drawn: DrawnFigure) -> str:
    uri = embedded(drawn.figure)
    if not drawn.tones:
        return uri
    picture = SVG_PICTURE.sub(_as_jpeg, base64.b64decode(uri.partition(",")[2]))
    return data_uri("svg+xml", picture)


def _as_jpeg(png: re.Match[bytes]) -> bytes:
    """Return a PNG within an SVG as JPEG on the ground of maps, where that is smaller."""
    with Image.open(io.BytesIO(base64.b64decode(png[1])), formats=["PNG"]) as picture:
        ground = Image.new("RGBA", picture.size, (*GROUND_RGB, 255))
        flat = Image.alpha_composite(ground, picture.convert("RGBA")).convert("RGB")
    stream = io.BytesIO()
    flat.save(stream, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    jpeg = data_uri("jpeg", stream.getvalue()).encode("ascii")
    return min(png[0], jpeg, key=lambda uri: len(uri.partition(b",")[2]))


# ---- one by one ----------------------------------------------------------------------------------------------------


def _length(length_m: float) -> str:
    return f"{length_m * 100:.3g} cm" if length_m < 1 else f"{length_m:.3g} m"


def drawn_orthophoto(orthophoto: OrthophotoPicture, ground: GroundMarks, language: Language = ENGLISH) -> DrawnFigure:
    """Draw an orthophoto with the ground points at their surveyed places, in a language."""
    rows, columns = orthophoto.source_shape
    caption = (
        f"Orthophoto, {columns} × {rows} cells of {_length(orthophoto.source_cell_m)} in orthophoto.tif, shown in "
        f"cells of {_length(orthophoto.cell_m)}: every cell is taken from the most suitable photograph, "
        "rectified by the surface model; where that has no height by what dsm_filled.tif has there. Grey: "
        "beyond the rim, masked, or hidden from all photographs. "
        "Symbols mark the surveyed coordinates of the ground points: their targets must lie under them."
    )
    alternative = language.gettext("Orthophoto with {n} ground points", n=len(ground.name))
    figure = orthophoto_figure(orthophoto, ground, WIDTH_IN, language)
    return DrawnFigure("orthophoto", figure, caption, alternative, tones=True, language=language)


def _relief(dense: DenseSurface, ground: GroundMarks, numbers: DenseRecord, language: Language) -> DrawnFigure:
    rows, columns = dense.heights.values.shape
    tested = {p["name"]: p["difference_m"] for p in numbers["check_points"]["points"]}
    cells, mapped = numbers["cells"], max(numbers["cells"]["mapped"], 1)
    part = f" {percent(cells['measured'] / mapped)} of the mapped cells are measured."
    filled = (
        f" {percent(cells['filled'] / mapped)} are filled from their neighbours (dsm_filled.tif)."
        if cells["filled"]
        else ""
    )
    differences = " Δh beside a check point is the height of the surface minus the surveyed one." if tested else ""
    caption = (
        f"Dense surface model of {columns} × {rows} cells of {_length(dense.cell_m)}, lit from the north-west, heights "
        f"enlarged for the shading.{part} Grey: holes, where the photographs do not agree on a height (closed in "
        f"dsm_filled.tif).{filled}"
        f"{differences}"
    )
    figure = relief_figure(dense, ground, tested, WIDTH_IN, language)
    alternative = language.gettext("Dense surface model, shaded and tinted by height")
    return DrawnFigure("dense surface", figure, caption, alternative, tones=True, language=language)


def _of_datum(datum_sigma_m: float | None) -> str:
    """Return what a caption says of sigmas without the datum's part, nothing of others."""
    if datum_sigma_m is None:
        return ""
    return (
        f" Relative to the survey’s mean height: the datum, ± {_length(datum_sigma_m)}, is common to all heights "
        "and excluded here; dsm_sigma.tif includes it."
    )


def _sigma(dense: DenseSurface, sigma: SigmaRecord, target_m: float | None, datum_sigma_m: float | None) -> DrawnFigure:
    classes = ""
    if target_m is not None:
        within = float(target_shares(dense, target_m)[:3].sum())
        classes = (
            f" Classes of the target for heights, {target_m:g} m as of the day of drawing: {percent(within)} of the "
            "measured cells lie within it (blue)."
        )
    caption = (
        "Predicted standard deviation of every height: the scatter of the matching, from how sharply the photographs "
        "agree and under which angles they look, together with the uncertainty of the adjusted photographs. "
        "It does not include mismatches, moving objects and vegetation, breaklines within cells, or errors "
        f"of the geoid and of the control survey’s datum. Median {sigma['median']:.3f} m."
        f"{_of_datum(datum_sigma_m)}{classes}"
    )
    alternative = "Map of the predicted standard deviation of the heights of the dense surface"
    return DrawnFigure("dense sigma", sigma_figure(dense, target_m, WIDTH_IN), caption, alternative)


def _histogram(dense: DenseSurface, numbers: DenseRecord, target_m: float | None) -> DrawnFigure:
    count = numbers["cells"]["measured"]
    caption = (
        f"Left: the predicted standard deviations of {count} measured cells. Right: how they fall with the "
        "number of matched photographs; median, middle two thirds, and the share of "
        "the cells."
    )
    figure = sigma_histogram_figure(dense, target_m, PLAN_IN + 0.6)
    return DrawnFigure("dense sigma histogram", figure, caption, "Histogram of standard deviations of heights")


def _rays(dense: DenseSurface, numbers: DenseRecord) -> DrawnFigure:
    share = numbers["share_3_or_more"]
    three = "" if share is None else f" {percent(share)} of the heights come from three photographs or more."
    caption = (
        "Number of photographs per matched height, and confidence of the match, 0 to 1. Heights from two "
        f"photographs are unchecked.{three} Low confidence: little texture, steps, leaves, or photographs "
        "that disagree."
    )
    alternative = "Maps of the number of photographs behind each height and of the confidence of its match"
    return DrawnFigure("dense rays", rays_figure(dense, PLAN_IN + 0.6), caption, alternative)


def _profiles(dense: DenseSurface, profiles: Sequence[Profile], datum_sigma_m: float | None) -> DrawnFigure:
    lines = "; ".join(f"{p.line.letter} runs {p.line.why}" for p in profiles)
    checks = (
        " Discs are check points beside a line with their surveyed heights; in the strip, the surface at their own "
        "place minus the survey, with 2 sigma of the survey."
        if any(p.check_points.name for p in profiles)
        else " No check point lies beside a line."
    )
    caption = (
        f"Profiles: {lines}. Below each, on a scale of its own, the band of ± 2 predicted sigma.{checks} Grey: "
        f"gaps, not interpolated.{_of_datum(datum_sigma_m)}"
    )
    figure = profile_figure(dense, profiles, PLAN_IN + 0.6)
    names = ", ".join(p.line.letter for p in profiles)
    known = float(np.mean([np.isfinite(p.height_m).mean() for p in profiles]))
    alternative = f"Profiles {names} through the dense surface, {percent(known)} of their length measured"
    return DrawnFigure("dense profiles", figure, caption, alternative)
