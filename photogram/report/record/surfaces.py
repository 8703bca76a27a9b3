"""What report.json says of point clouds, surface models and the orthophoto."""

from typing import Annotated, NotRequired, final

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.block import WorldRecord
from photogram.report.record.units import Count, Degrees, EarthMetres, Metres, Position, Share, SquareMetres

PlanMetres = Annotated[list[EarthMetres], Field(min_length=2, max_length=2)]
"""Easting and northing in the map, or differences of such."""


class DifferencesRecord(TypedDict):
    """Mean, standard deviation, median and normalised median absolute deviation of differences."""

    mean_m: Metres | None
    std_m: Metres | None
    median_m: Metres | None
    nmad_m: Metres | None


class CloudRecord(DifferencesRecord):
    """Size of a point cloud, and its heights over the reference; null or absent without one."""

    points: Count
    compared: NotRequired[Count]
    removed_by_sor: NotRequired[Count]
    cloud_to_cloud: NotRequired[DifferencesRecord]


class SigmaRecord(TypedDict):
    """The spread of predicted standard deviations of heights."""

    median: Metres
    mean: Metres
    percentile_95: Metres
    maximum: Metres


class DatumSigmaRecord(TypedDict):
    """Standard deviations of the mean error of the ground, which all cells share."""

    easting: Metres | None
    northing: Metres | None
    height: Metres | None


class HeldOutRecord(TypedDict):
    """Heights of tie points that were held out of the surface, against it."""

    n: Count
    rmse_m: Metres | None
    nmad_m: Metres | None


class DsmRecord(TypedDict):
    """Size of the surface model and its standard deviations."""

    rows: Count
    columns: Count
    cell_m: Metres
    cells: Count
    sigma_m: SigmaRecord
    relative_sigma_m: SigmaRecord | None
    datum_sigma_m: DatumSigmaRecord | None
    held_out: HeldOutRecord


class NoSurfaceRecord(TypedDict):
    """Why there is no surface model."""

    left_out: str


class AxesRecord(TypedDict):
    """Three axes by name, each along three others."""

    x: Position
    y: Position
    z: Position


class PlaneFrameRecord(TypedDict):
    """How coordinates on the plane of a surface become those of the world, exactly, and of the map, within
    ``map_error_m`` everywhere on the surface: origin + x · axes.x + y · axes.y + z · axes.z."""

    origin_world_m: Position
    axes_world: AxesRecord
    origin_map_m: Position
    axes_map: AxesRecord
    map_error_m: Metres | None


class PlaneFileRecord(PlaneFrameRecord):
    """What plane.json holds."""

    about: str
    crs: str
    world: WorldRecord


class PlaneRecord(TypedDict):
    """The plane fitted to the tie points: whether the surface lies on it, how it leans, what it was fitted to, and,
    where it is used, its frame."""

    used: bool
    tilt_deg: Degrees
    facing_deg: Degrees | None
    points: Count
    share_on_plane: Share
    within_m: Metres
    nmad_m: Metres
    relief_m: Metres
    points_beyond: Count
    frame: PlaneFrameRecord | None
    left_out: list[str]
    sentence: str


class CellsRecord(TypedDict):
    """Cells of the dense surface: those mapped, which two photographs or more show, are measured, filled from their
    neighbours, on water or interpolated from farther off, and these add up; how many two photographs or more, or three,
    show, and how many of these are measured and on water, null where no more than two were asked."""

    grid: Count
    mapped: Count
    measured: Count
    filled: Count
    water: Count
    interpolated: Count
    seen_2_or_more: Count
    seen_3_or_more: Count | None
    measured_of_these: Count | None
    water_of_these: Count | None


class AreasRecord(TypedDict):
    """The same in m², and what is not mapped, since photographs see it only obliquely and coarsely."""

    mapped_m2: SquareMetres
    measured_m2: SquareMetres
    filled_m2: SquareMetres
    water_m2: SquareMetres
    interpolated_m2: SquareMetres
    seen_3_or_more_m2: SquareMetres | None
    left_out_m2: SquareMetres


class WaterAreaRecord(TypedDict):
    """An area of water: its size and its level."""

    area_m2: float
    level_map_m: Metres


class WaterRecord(TypedDict):
    """Water that was found in the dense surface: its cells, their share of the mapped ones, and its areas."""

    cells: Count
    share: Share | None
    areas: list[WaterAreaRecord]


class ConfidenceRecord(TypedDict):
    """The spread of the confidence, 0 to 1, of measured cells."""

    median: float
    mean: float
    percentile_5: float
    minimum: float


class UsedPhotographsRecord(TypedDict):
    """The photographs that took part in the matching."""

    used: Count
    names: list[str]


class SurfacePointRecord(TypedDict):
    """A check point on the dense surface: surface minus survey, and the standard deviations of both."""

    name: str
    surveyed_m: Metres
    surface_m: Metres
    difference_m: Metres
    sigma_m: Metres | None
    survey_sigma_m: Metres | None
    z: float | None


class UntestedPointRecord(TypedDict):
    """A check point that does not test the surface, and why."""

    name: str
    reason: str


class SurfaceSummaryRecord(TypedDict):
    """Heights of the dense surface minus those of check points; null with too few."""

    n: Count
    mean_m: Metres | None
    sd_m: Metres | None
    rmse_m: Metres | None
    survey_rmse_m: Metres | None
    rmse_v_m: Metres | None
    rms_z: float | None


class SurfaceCheckRecord(SurfaceSummaryRecord):
    """The dense surface at the check points, and each of them."""

    points: list[SurfacePointRecord]
    not_tested: list[UntestedPointRecord]
    sentence: str


class DenseRecord(TypedDict):
    """The dense surface model, cell by cell, and its test at the check points."""

    cell_m: Metres
    rows: Count
    columns: Count
    cells: CellsRecord
    areas: AreasRecord
    completeness: Share | None
    by_rays: dict[str, Count]
    by_level: dict[str, Count]
    share_3_or_more: Share | None
    sigma_m: SigmaRecord | None
    confidence: ConfidenceRecord | None
    photographs: UsedPhotographsRecord
    settings: dict[str, bool | int | float | str | None]
    check_points: SurfaceCheckRecord
    warnings: list[str]
    matching_sigma_m: Metres | None
    water: NotRequired[WaterRecord]


class OrthophotoPointRecord(TypedDict):
    """A check point's target in the orthophoto: easting and northing, shown minus surveyed, and the survey's sigmas."""

    name: str
    found_map_m: PlanMetres
    difference_m: PlanMetres
    survey_sigma_m: PlanMetres
    correlation: float
    marks: Count


class OrthophotoCheckRecord(TypedDict):
    """The orthophoto at the check points whose targets were found in it; null with too few."""

    n: Count
    mean_m: PlanMetres | None
    rmse_m: PlanMetres | None
    fit_rmse_h_m: Metres | None
    survey_rmse_h_m: Metres | None
    rmse_h_m: Metres | None
    points: list[OrthophotoPointRecord]
    not_tested: list[UntestedPointRecord]
    sentence: str


class RimRecord(TypedDict):
    """The rim of the orthophoto: the area within, m², and the share of its cells that is transparent."""

    area_m2: float
    transparent: Share


@final
class OrthophotoRecord(TypedDict):
    """Size of orthophoto.tif, the share of it that shows anything, its rim, and its test at the check points."""

    cell_m: Metres
    rows: Count
    columns: Count
    covered: Share
    rim: RimRecord
    check_points: NotRequired[OrthophotoCheckRecord]


@final
class NoOrthophotoRecord(TypedDict):
    """Why there is no orthophoto."""

    left_out: str
