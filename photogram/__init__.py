"""Bundle-adjustment photogrammetry: photographs and ground control to a surface model that says how good it is.

    import photogram as pg

    pg.init("photographs/", control="gcp_list.txt")      # writes project.yaml
    pg.check("project.yaml")                             # what is wrong with it, before the work
    survey = pg.open("project.yaml").update(until="adjustment", progress=print)
    survey.adjustment()                                  # estimates, residuals, covariances

Names are resolved when they are first used, so that importing photogram imports nothing that computes. Arrays carry
unit and frame in their names: ``_px`` pixels (the centre of the top-left pixel is (0, 0)), ``_world_m`` the local
east-north-up frame of a survey, ``_map_m`` the map grid of the project. What a user can mend is raised as a
PhotogramError whose message says what to do.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.2.0"

__all__ = [
    "Adjustment",
    "AdjustmentError",
    "AdjustmentSettings",
    "Block",
    "Camera",
    "CloudRequest",
    "ContourSettings",
    "ControlPointError",
    "ControlPoints",
    "DamagedStageError",
    "ExchangeError",
    "FeatureSettings",
    "Findings",
    "FlightPlan",
    "FrameError",
    "ImageError",
    "ImportedProject",
    "LocalFrame",
    "M3C2Settings",
    "MatchingSettings",
    "NewProject",
    "OpenedSurvey",
    "OrientationError",
    "OrientationSettings",
    "PhotogramError",
    "Photograph",
    "PointCloud",
    "Pose",
    "ProjectError",
    "Raster",
    "ReportError",
    "SettingError",
    "StatedSigma",
    "Stretch",
    "SurfaceRequest",
    "SurfaceSettings",
    "SurveyPlan",
    "TiePoints",
    "WorkspaceError",
    "__version__",
    "adjust",
    "asprs_accuracy",
    "calibrate_site",
    "check",
    "check_accuracy",
    "compare",
    "compare_clouds",
    "compare_surfaces",
    "contour_lines",
    "diagnose",
    "export_marks",
    "export_solution",
    "find_features",
    "find_sky",
    "find_stretch",
    "import_solution",
    "init",
    "intersect",
    "join_matches",
    "match_pair",
    "open",
    "orient",
    "predict",
    "project_points",
    "read_cloud",
    "read_mask",
    "read_photograph",
    "read_raster",
    "render_photographs",
    "resect",
    "simulate",
    "snoop",
    "surface_from_points",
    "unproject",
    "view",
    "write_mask",
    "write_raster",
    "write_survey",
]

_PLACES = {
    # a survey on disk
    "NewProject": "photogram.pipeline.new_project:NewProject",
    "init": "photogram.pipeline.new_project:init",
    "Findings": "photogram.project.findings:Findings",
    "check": "photogram.pipeline.input_validation:validate_project_file",
    "OpenedSurvey": "photogram.pipeline.opened_survey:OpenedSurvey",
    "open": "photogram.pipeline.opened_survey:open_survey",
    "view": "photogram.pipeline.view:write_view",
    "export_marks": "photogram.marking.mark_export:export_marks",
    "export_solution": "photogram.exchange.solution_export:export_solution",
    "ImportedProject": "photogram.exchange.solution_import:ImportedProject",
    "import_solution": "photogram.exchange.solution_import:import_solution",
    # the data of a survey
    "Block": "photogram.survey:Block",
    "Camera": "photogram.camera:Camera",
    "ControlPoints": "photogram.survey:ControlPoints",
    "LocalFrame": "photogram.frames:LocalFrame",
    "Photograph": "photogram.survey:Photograph",
    "PointCloud": "photogram.survey:PointCloud",
    "Pose": "photogram.camera:Pose",
    "Raster": "photogram.survey:Raster",
    "TiePoints": "photogram.survey:TiePoints",
    # from photographs to starting poses
    "FeatureSettings": "photogram.sfm.tie_points.features:FeatureSettings",
    "find_features": "photogram.sfm.tie_points.features:find_features",
    "find_sky": "photogram.sfm.sky:find_sky",
    "MatchingSettings": "photogram.sfm.tie_points.matching:MatchingSettings",
    "match_pair": "photogram.sfm.tie_points.matching:match_pair",
    "join_matches": "photogram.sfm.tie_points.tracks:join_matches",
    "OrientationSettings": "photogram.sfm.orientation:OrientationSettings",
    "orient": "photogram.sfm.orientation:orient",
    # geometry of single photographs
    "project_points": "photogram.camera:project",
    "unproject": "photogram.camera:unproject",
    "resect": "photogram.sfm.resection:resect",
    "intersect": "photogram.triangulation:intersect",
    # the joint adjustment, and what it is worth
    "Adjustment": "photogram.results:Adjustment",
    "AdjustmentSettings": "photogram.adjustment.problem:AdjustmentSettings",
    "adjust": "photogram.adjustment.adjustment:adjust",
    "snoop": "photogram.quality.gross_errors.snooped_adjustment:adjust_and_judge",
    "diagnose": "photogram.quality.diagnosis:diagnose",
    "check_accuracy": "photogram.quality.accuracy:check_accuracy",
    "asprs_accuracy": "photogram.quality.asprs:accuracy",
    "calibrate_site": "photogram.local_grids.site_calibration:calibrate_site",
    # surfaces
    "SurfaceSettings": "photogram.surface.tin_dsm:SurfaceSettings",
    "surface_from_points": "photogram.surface.tin_dsm:surface_from_points",
    "ContourSettings": "photogram.surface.contours:ContourSettings",
    "contour_lines": "photogram.surface.contours:contour_lines",
    "compare": "photogram.quality.cloud_comparison:compare",
    # two epochs
    "SurfaceRequest": "photogram.change.surface_change:SurfaceRequest",
    "compare_surfaces": "photogram.change.surface_change:compare_surfaces",
    "CloudRequest": "photogram.change.cloud_change:CloudRequest",
    "compare_clouds": "photogram.change.cloud_change:compare_clouds",
    "M3C2Settings": "photogram.change.m3c2:M3C2Settings",
    "StatedSigma": "photogram.change.surfaces:StatedSigma",
    # surveys that were never flown
    "SurveyPlan": "photogram.simulation.survey_plan:SurveyPlan",
    "simulate": "photogram.simulation.simulated_survey:simulate",
    "render_photographs": "photogram.simulation.simulated_survey:render_photographs",
    "write_survey": "photogram.simulation.survey_files:write_survey_folder",
    "FlightPlan": "photogram.simulation.planning.flight_plan:FlightPlan",
    "predict": "photogram.simulation.planning.prediction:predict",
    # files
    "read_mask": "photogram.files.photographs.masks:read_mask",
    "read_photograph": "photogram.files.photographs.images:read_pixels",
    "Stretch": "photogram.files.photographs.depth:Stretch",
    "find_stretch": "photogram.files.photographs.stretches:find_stretch",
    "write_mask": "photogram.files.photographs.masks:write_mask",
    "read_cloud": "photogram.files.clouds.points:read_cloud",
    "read_raster": "photogram.files.maps.rasters:read_raster",
    "write_raster": "photogram.files.maps.rasters:write_geotiff",
    # faults that a user can mend
    "PhotogramError": "photogram.errors:PhotogramError",
    "AdjustmentError": "photogram.errors:AdjustmentError",
    "ControlPointError": "photogram.errors:ControlPointError",
    "DamagedStageError": "photogram.errors:DamagedStageError",
    "ExchangeError": "photogram.errors:ExchangeError",
    "FrameError": "photogram.errors:FrameError",
    "ImageError": "photogram.errors:ImageError",
    "OrientationError": "photogram.errors:OrientationError",
    "ProjectError": "photogram.errors:ProjectError",
    "ReportError": "photogram.errors:ReportError",
    "SettingError": "photogram.errors:SettingError",
    "WorkspaceError": "photogram.errors:WorkspaceError",
}
"""Where every public name is defined: its module, and the name that it has there."""

if TYPE_CHECKING:  # the same table for type checkers and editors
    from photogram.adjustment.adjustment import adjust
    from photogram.adjustment.problem import AdjustmentSettings
    from photogram.camera import Camera, Pose, unproject
    from photogram.camera import project as project_points
    from photogram.change.cloud_change import CloudRequest, compare_clouds
    from photogram.change.m3c2 import M3C2Settings
    from photogram.change.surface_change import SurfaceRequest, compare_surfaces
    from photogram.change.surfaces import StatedSigma
    from photogram.errors import (
        AdjustmentError,
        ControlPointError,
        DamagedStageError,
        ExchangeError,
        FrameError,
        ImageError,
        OrientationError,
        PhotogramError,
        ProjectError,
        ReportError,
        SettingError,
        WorkspaceError,
    )
    from photogram.exchange.solution_export import export_solution
    from photogram.exchange.solution_import import ImportedProject, import_solution
    from photogram.files.clouds.points import read_cloud
    from photogram.files.maps.rasters import read_raster
    from photogram.files.maps.rasters import write_geotiff as write_raster
    from photogram.files.photographs.depth import Stretch
    from photogram.files.photographs.images import read_pixels as read_photograph
    from photogram.files.photographs.masks import read_mask, write_mask
    from photogram.files.photographs.stretches import find_stretch
    from photogram.frames import LocalFrame
    from photogram.local_grids.site_calibration import calibrate_site
    from photogram.marking.mark_export import export_marks
    from photogram.pipeline.input_validation import validate_project_file as check
    from photogram.pipeline.new_project import NewProject, init
    from photogram.pipeline.opened_survey import OpenedSurvey
    from photogram.pipeline.opened_survey import open_survey as open
    from photogram.pipeline.view import write_view as view
    from photogram.project.findings import Findings
    from photogram.quality.accuracy import check_accuracy
    from photogram.quality.asprs import accuracy as asprs_accuracy
    from photogram.quality.cloud_comparison import compare
    from photogram.quality.diagnosis import diagnose
    from photogram.quality.gross_errors.snooped_adjustment import adjust_and_judge as snoop
    from photogram.results import Adjustment
    from photogram.sfm.orientation import OrientationSettings, orient
    from photogram.sfm.resection import resect
    from photogram.sfm.sky import find_sky
    from photogram.sfm.tie_points.features import FeatureSettings, find_features
    from photogram.sfm.tie_points.matching import MatchingSettings, match_pair
    from photogram.sfm.tie_points.tracks import join_matches
    from photogram.simulation.planning.flight_plan import FlightPlan
    from photogram.simulation.planning.prediction import predict
    from photogram.simulation.simulated_survey import render_photographs, simulate
    from photogram.simulation.survey_files import write_survey_folder as write_survey
    from photogram.simulation.survey_plan import SurveyPlan
    from photogram.surface.contours import ContourSettings, contour_lines
    from photogram.surface.tin_dsm import SurfaceSettings, surface_from_points
    from photogram.survey import Block, ControlPoints, Photograph, PointCloud, Raster, TiePoints
    from photogram.triangulation import intersect

else:  # type checkers would take any name for one that this finds

    def __getattr__(name: str) -> object:
        if name not in _PLACES:
            raise AttributeError(f"module 'photogram' has no attribute {name!r}")
        module, definition = _PLACES[name].split(":")
        found: object = getattr(import_module(module), definition)
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
