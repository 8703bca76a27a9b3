"""Figures of the report page: drawn once with the results, kept as pictures that stand within the page itself.

Vector graphics, the same bytes for the same data, sized for a page of A4.
"""

import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import binned_statistic_2d, norm

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, LensField
from photogram.languages.codes import LanguageCode
from photogram.languages.language import ENGLISH, Language
from photogram.measures.round_lengths import round_down
from photogram.quality.cloud_comparison import Comparison
from photogram.quality.residual_patterns import ResidualPattern, residual_patterns
from photogram.report.figures.difference_figure import DifferencePicture, difference_figure
from photogram.report.figures.plan_view import plan_contents, plan_figure
from photogram.report.figures.style import (
    BLUE,
    GREEN,
    GREY,
    SKY,
    VERMILION,
    comparison_figure,
    data_uri,
    field_figure,
    length_label,
    map_axes,
    new_figure,
    plain_axes,
    residual_figure,
    surface_figure,
    write_figure,
)
from photogram.report.numbers.overlap import Overlap
from photogram.report.titles import CLOUD_TITLES
from photogram.results import Adjustment
from photogram.survey import PointCloud, Raster
from photogram.wording import percent

PLAN_IN, WIDTH_IN = 6.6, 5.4
MAXIMUM_ELLIPSE_NAMES = 40
IMAGE_DPI = 170


CLIENTS = frozenset({"plan", "surface", "dense surface", "orthophoto"})
"""Figures of the client's part, by their keys: drawn in its language."""


@dataclass(frozen=True)
class PageFigure:
    """A picture of the page: its ``key``, a ``caption``, what stands for it where it is not seen, its data URI, and the
    language of its labels and ``alternative``."""

    key: str
    caption: str
    alternative: str
    uri: str
    language: LanguageCode = "en"

    def to_json(self) -> dict[str, str]:
        """Return the figure as JSON."""
        return asdict(self)


def embedded(figure: Figure) -> str:
    """Return a figure as a data URI of scalable graphics, without date."""
    stream = io.BytesIO()
    figure.dpi = IMAGE_DPI
    with mpl.rc_context({"svg.hashsalt": "photogram", "svg.fonttype": "path", "svg.image_inline": True}):
        write_figure(figure, stream, "svg", metadata={"Date": None, "Creator": None})
    return data_uri("svg+xml", stream.getvalue())


def page_figures(
    result: Adjustment,
    overlap: Overlap | None,
    cloud: PointCloud,
    surface: Raster | None,
    comparisons: Mapping[str, Comparison],
    *,
    upright: bool,
    component: IntArray | None = None,
    language: Language = ENGLISH,
) -> list[PageFigure]:
    """Draw every figure of the page for which there are data, those of the client's part in a language; ``surface`` is
    that of the tie points, in plan or on an ``upright`` plane, None where a dense one takes its place;
    ``component`` (N,) as ``PlanContents`` has it."""
    figures = [_plan(result, overlap, component, language), _ellipses(result), *_residuals(result), _histograms(result)]
    figures += [
        _height_sigma(cloud),
        None if surface is None else _surface(surface, upright, language),
        _comparison(comparisons),
    ]
    return [figure for figure in figures if figure is not None]


def _plan(result: Adjustment, overlap: Overlap | None, component: IntArray | None, language: Language) -> PageFigure:
    contents = plan_contents(result, overlap, component)
    caption = (
        "Photographs by flight, control and check points, and how many photographs see the ground: warm colours up to "
        "two, whose heights are unchecked, blue from three. Arrows are residuals in plan, adjusted minus measured or "
        "surveyed, enlarged as written above the map; Δh is the residual in height."
    )
    if component is not None and component.max(initial=0) > 0:
        caption += " Dashed lines: components that share no tie points, by their number."
    alternative = language.gettext(
        "Plan of {photographs} photographs and {points} ground points",
        photographs=len(contents.photograph_names),
        points=len(contents.ground_names),
    )
    figure = plan_figure(contents, widest_in=PLAN_IN, language=language)
    return PageFigure("plan", caption, alternative, embedded(figure), language.code)


def volumes_figure(picture: DifferencePicture) -> PageFigure:
    """Return the picture of volumes for the page."""
    caption = (
        "Polygons whose volumes were measured: colours are heights above the base within them, pale where they are "
        f"within what errors explain (95 %); {picture.earlier} is the base. Beside them the surface, lit from the "
        "north-west."
    )
    alternative = f"Map of {len(picture.polygons)} polygons with their volumes"
    return PageFigure("volumes", caption, alternative, embedded(difference_figure(picture)))


# ---- error ellipses ------------------------------------------------------------------------------------------------


def standard_ellipses(covariance_m2: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return semi-major and semi-minor axes (N,) in m and directions (N,) of the major one, in degrees from east to
    north, of the 1-sigma ellipses of covariances (N, 2, 2) in plan."""
    value, vector = np.linalg.eigh(covariance_m2)
    minor, major = np.sqrt(np.maximum(value, 0.0)).T
    return major, minor, np.degrees(np.arctan2(vector[:, 1, 1], vector[:, 0, 1]))


@dataclass(frozen=True, eq=False)
class _Uncertain:
    """Places (N, 3) in the map, m, with covariances (N, 3, 3) along its axes, and what they are called."""

    title: str
    colour: str
    place_map_m: FloatArray
    covariance_m2: FloatArray
    names: tuple[str, ...] = ()


def _ellipses(result: Adjustment) -> PageFigure | None:
    """Draw the predicted 1-sigma ellipses of projection centres and ground points, with bars for the heights."""
    frame, points = result.block.frame, result.block.control_points
    R = frame.rotation_world_from_map(np.zeros(3))
    registered = [i for i, pose in enumerate(result.block.poses) if pose is not None]
    poses = [pose for pose in result.block.poses if pose is not None]
    known = np.flatnonzero(np.isfinite(result.estimates.ground_world_m).all(axis=1))
    roles = np.asarray(points.role, dtype=str)[known] if len(points) else np.zeros(0, dtype=str)
    centre = np.array([p.position_world_m for p in poses]).reshape(-1, 3)
    covariance = result.covariances.position_m2[registered]
    groups = [_Uncertain("projection centres", BLUE, frame.map_from_world(centre), R.T @ covariance @ R)]
    for role, colour in (("control", VERMILION), ("check", GREEN)):
        chosen = known[roles == role]
        place = frame.map_from_world(result.estimates.ground_world_m[chosen])
        covariance = result.covariances.ground_m2[chosen]
        names = tuple(points.name[g] for g in chosen)
        groups.append(_Uncertain(f"{role} points", colour, place, R.T @ covariance @ R, names))
    groups = [g for g in groups if len(g.place_map_m) and np.isfinite(g.covariance_m2).all()]
    if not groups:
        return None
    figure, scales = _ellipse_figure(groups)
    enlarged = ", ".join(f"{title} {scale:g} times" for title, scale in scales.items())
    caption = (
        "Predicted standard ellipses in plan (1 sigma: 39 % lie within) and standard deviations in height as upright "
        f"bars, enlarged: {enlarged}. They follow from the stated sigmas of all observations, not from residuals."
    )
    return PageFigure("ellipses", caption, "Error ellipses of projection centres and ground points", embedded(figure))


def _ellipse_figure(groups: list[_Uncertain]) -> tuple[Figure, dict[str, float]]:
    """Draw ellipses, those of photographs and of ground points on a scale each; return the scales by title."""
    places = np.vstack([group.place_map_m[:, :2] for group in groups])
    low, high = places.min(axis=0), places.max(axis=0)
    span = float(max((high - low).max(), 1.0))
    low, high = low - 0.12 * span, high + 0.12 * span
    high = np.maximum(high, low + 0.4 * (high - low).max())
    aspect = float((high - low)[1] / (high - low)[0])
    width_in = float(min(WIDTH_IN, 6.0 / aspect))
    figure = new_figure(width_in + 0.6, width_in * aspect + 1.5)
    axes = figure.add_subplot(facecolor="#fafafa")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    map_axes(axes)
    axes.grid(visible=True, color="#dddddd", linewidth=0.5)
    axes.set_axisbelow(True)
    named = sum(len(group.names) for group in groups) <= MAXIMUM_ELLIPSE_NAMES
    handles, scales = [], dict[str, float]()
    for group in groups:
        alike = [g for g in groups if bool(g.names) == bool(group.names)]
        scales[group.title] = scale = _ellipse_scale(alike, span)
        _draw_ellipses(axes, group.colour, group.place_map_m, group.covariance_m2, scale)
        label = f"{group.title} ({len(group.place_map_m)}), × {scale:g}"
        handles.append(Line2D([], [], marker="o", linestyle="", mfc="none", mec=group.colour, label=label))
        for name, (east, north, _) in zip(group.names, group.place_map_m, strict=False):
            if named:
                axes.annotate(name, (east, north), (6, 5), textcoords="offset points", fontsize=7, color=GREY)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    _sigma_keys(axes, groups, scales, span)
    return figure, scales


def _ellipse_scale(groups: list[_Uncertain], span_m: float) -> float:
    """Return the round enlargement that draws a large but usual sigma of these groups as a twentieth of the plan."""
    sigma = np.concatenate([np.sqrt(np.einsum("nii->ni", g.covariance_m2)).max(axis=1) for g in groups])
    return round_down(0.05 * span_m / max(float(np.percentile(sigma, 90)), 1e-9))


def _sigma_keys(axes: Axes, groups: list[_Uncertain], scales: Mapping[str, float], span: float) -> None:
    """Draw above the map how long a round sigma is on each scale."""
    west, north = axes.get_xlim()[0], axes.get_ylim()[1]
    place = west
    for scale in dict.fromkeys(scales.values()):
        key_m = round_down(0.07 * span / scale)
        titles = [group for group in groups if scales[group.title] == scale]
        height = north + 0.035 * span
        axes.plot(
            [place, place + scale * key_m], [height] * 2, color=titles[0].colour, linewidth=2, clip_on=False,
            solid_capstyle="butt",
        )  # fmt: skip
        what = "projection centres" if not titles[0].names else "ground points"
        axes.annotate(
            f"1 sigma of {length_label(key_m)}, {what}",
            (place + scale * key_m, height),
            (5, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            annotation_clip=False,
        )
        place += 0.62 * span


def _draw_ellipses(axes: Axes, colour: str, place: FloatArray, covariance_m2: FloatArray, scale: float) -> None:
    major, minor, direction = standard_ellipses(covariance_m2[:, :2, :2])
    axes.add_collection(
        EllipseCollection(
            2 * scale * major,
            2 * scale * minor,
            direction,
            units="xy",
            offsets=place[:, :2],
            transOffset=axes.transData,
            facecolors="none",
            edgecolors=colour,
            linewidths=1.1,
            zorder=4,
        )
    )
    height = scale * np.sqrt(covariance_m2[:, 2, 2])
    bars = np.stack([place[:, :2], place[:, :2]], axis=1)
    bars[:, 0, 1] -= height
    bars[:, 1, 1] += height
    axes.add_collection(LineCollection(list(bars), colors=colour, linewidths=0.7, alpha=0.6, zorder=3))
    axes.plot(*place[:, :2].T, ".", color=colour, markersize=2.5, zorder=5)


# ---- image residuals -----------------------------------------------------------------------------------------------


def _residuals(result: Adjustment) -> list[PageFigure]:
    block = result.block
    figures = []
    patterns = residual_patterns(result)
    for c, camera in enumerate(block.cameras):
        seen = np.array([p.camera == c for p in block.photographs], dtype=bool)[block.tie_points.photograph]
        if seen.any():
            figure = residual_figure(
                camera, block.tie_points.pixel[seen], result.estimates.residual_px[seen], width_in=PLAN_IN
            )
            caption = residual_caption(camera.name, patterns.get(camera.name))
            figures.append(PageFigure(f"residuals {c}", caption, f"Image residuals of {camera.name}", embedded(figure)))
        if camera.field is not None:
            figures.append(_lens_field(c, camera, camera.field, result.covariances.lens_field_px2[c]))
    return figures


def _lens_field(c: int, camera: Camera, field: LensField, covariance_px2: FloatArray) -> PageFigure:
    figure = field_figure(camera, field, covariance_px2, width_in=PLAN_IN)
    caption = (
        f"Lens field of {camera.name}: by how much its lens shows points beside where its parameters put them, "
        "enlarged. It is free of what these parameters and a turn of the camera describe. Other programs that have "
        "no such field leave it in their residuals."
    )
    return PageFigure(f"residuals {c} field", caption, f"Lens field of {camera.name}", embedded(figure))


def residual_caption(camera: str, pattern: ResidualPattern | None) -> str:
    """Return what stands under the residuals of a camera, with what they have in common where that is known."""
    caption = (
        f"Residuals of tie points in {camera} by their place in the photograph, projected minus measured. No "
        "pattern: the camera model fits; arrows pointing outwards, inwards or around the principal point "
        "show residual distortion."
    )
    if pattern is None:
        return caption
    significance = "significant" if pattern.significant else "not significant"
    return (
        f"{caption} Their systematic part, common to all photographs, has an RMS of "
        f"{pattern.pattern_px:.2g} px for a coordinate, of the residuals' {pattern.residual_px:.2g} px: {significance}."
    )


def _histograms(result: Adjustment) -> PageFigure | None:
    tie = result.block.tie_points
    if not len(tie.photograph):
        return None
    figure = new_figure(PLAN_IN + 0.6, 2.7)
    left, right = figure.subplots(1, 2)
    values = result.estimates.residual_px
    spread = max(float(np.sqrt(np.mean(values**2))), 1e-3)
    reach = 3.5 * spread
    for k, (name, colour) in enumerate((("u", BLUE), ("v", VERMILION))):
        left.hist(
            values[:, k], bins=61, range=(-reach, reach), histtype="step", color=colour, label=name, linewidth=1.2
        )
    x = np.linspace(-reach, reach, 200)
    stated = float(np.median(tie.sigma_px))
    per_bin = len(values) * 2 * reach / 61
    left.plot(x, per_bin * norm.pdf(x, scale=spread), color=GREY, linewidth=1, label=f"normal, {spread:.2f} px")
    left.set(xlabel="residual, px", ylabel="observations", xlim=(-reach, reach))
    left.legend(frameon=False, fontsize=8)
    rays = np.bincount(tie.rays)[2:]
    right.bar(np.arange(2, 2 + len(rays)), rays, color=SKY, width=0.8)
    right.set(xlabel="photographs per point", ylabel="tie points")
    for axes in (left, right):
        plain_axes(axes)
    caption = (
        f"Left: residuals of {len(values)} tie-point observations; their RMS is {spread:.2f} px per coordinate, "
        f"the median of the stated sigmas {stated:.2f} px. Right: how many photographs see a tie point; two "
        "rays cannot reveal most mismatches."
    )
    return PageFigure(
        "histograms", caption, "Histograms of image residuals and of rays per tie point", embedded(figure)
    )


# ---- surfaces ------------------------------------------------------------------------------------------------------


def _height_sigma(cloud: PointCloud) -> PageFigure | None:
    """Draw the predicted standard deviation of heights, the median of the tie points of each cell."""
    if cloud.sigma_m is None or len(cloud) < 3:
        return None
    easting, northing = cloud.position_map_m[:, :2].T
    low, high = np.percentile(cloud.position_map_m[:, :2], [0.5, 99.5], axis=0)
    span = high - low
    if not span.max() > 0:
        return None
    cells = int(np.clip(np.sqrt(len(cloud) / 3.0), 10, 90))
    counts = np.maximum(np.ceil(cells * span / span.max()), 2).astype(np.int64)
    edges = [np.linspace(low[k], high[k], counts[k] + 1) for k in range(2)]
    sigma_m = binned_statistic_2d(easting, northing, cloud.sigma_m[:, 2], "median", bins=edges).statistic.T[::-1]
    known = sigma_m[np.isfinite(sigma_m)]
    tint = ScalarMappable(Normalize(float(known.min()), float(np.percentile(known, 98)) + 1e-6), "cividis_r")
    width_in = float(min(WIDTH_IN, 6.0 * span[0] / span[1]))
    figure = new_figure(width_in + 1.4, max(width_in * span[1] / span[0], 2.0) + 0.9)
    axes = figure.add_subplot(facecolor="#dddddd")
    colours = tint.to_rgba(np.ma.masked_invalid(sigma_m))
    axes.imshow(colours, extent=(low[0], high[0], low[1], high[1]), interpolation="nearest")
    map_axes(axes)
    bar = figure.colorbar(tint, ax=axes, shrink=0.8, extend="max", pad=0.02)
    bar.set_label("sigma of heights, m (grey: no tie points)", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    caption = (
        f"Predicted standard deviation of the heights of {len(cloud)} tie points: the median of each cell, whose "
        f"median is {float(np.median(known)):.3f} m. Heights are weakest where few photographs see the ground, and "
        "at the margin."
    )
    return PageFigure("height sigma", caption, "Map of the predicted standard deviation of heights", embedded(figure))


def _surface(surface: Raster, upright: bool, language: Language) -> PageFigure:
    rows, columns = surface.values.shape
    light = "upper left, on the plane as the photographs see it," if upright else "north-west"
    caption = (
        f"Digital surface model of {columns} × {rows} cells of {surface.cell_m:g} m, lit from the {light} "
        f"({percent(np.isfinite(surface.values).mean())} of the cells hold a height)."
    )
    figure = surface_figure(surface, widest_in=WIDTH_IN, upright=upright, language=language)
    alternative = language.gettext("Digital surface model, shaded and tinted by height")
    return PageFigure("surface", caption, alternative, embedded(figure), language.code)


def _comparison(comparisons: Mapping[str, Comparison]) -> PageFigure | None:
    if not comparisons:
        return None
    titled = {CLOUD_TITLES[name]: comparison for name, comparison in comparisons.items()}
    figure = comparison_figure(titled, upright=True)
    caption = (
        "Heights of the clouds over the reference surface, after the statistical outlier filter: maps and histograms "
        "on one scale. It measures accuracy only if the reference is better than the cloud."
    )
    return PageFigure("comparison", caption, "Differences of the clouds from the reference", embedded(figure))
