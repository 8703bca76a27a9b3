"""The public names, and the module that defines each: for type checkers and editors, and for the package itself."""

from .adjustment.adjustment import adjust
from .adjustment.problem import AdjustmentSettings
from .amendments.snooped_adjustment import Verdict, adjust_with_snooping
from .camera import Camera, Pose, project_points, unproject
from .change.cloud_change import CloudRequest, compare_clouds
from .change.m3c2 import M3C2Settings
from .change.reference_comparison import compare_files_to_reference, write_comparison
from .change.surface_change import SurfaceRequest, compare_surfaces
from .delivery.hand_over import Delivered, deliver
from .donation.donation import Donation, read_donation
from .errors import (
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
    SurfaceError,
    WorkspaceError,
)
from .exchange.audit.page import AuditTables
from .exchange.formats.recognition import read_solution
from .exchange.solution_audit import audit, write_audit
from .exchange.solution_export import export_solution
from .exchange.solution_import import ImportedProject, import_solution
from .files.clouds.points import read_cloud
from .files.maps.rasters import read_raster, write_raster
from .files.photographs.depth import Stretch
from .files.photographs.images import read_photograph
from .files.photographs.masks import read_mask, write_mask
from .files.photographs.stretches import find_stretch
from .files.solutions.solution import ForeignSolution
from .geodesy.frames import LocalFrame
from .local_grids.site_calibration import calibrate_site
from .marking.detection import DetectedTargets, detect_targets
from .marking.mark_export import export_marks
from .pipeline.finished_report import write_report
from .pipeline.input_validation import check_project
from .pipeline.new_project import NewProject, init
from .pipeline.opened_survey import OpenedSurvey, open_survey
from .pipeline.view import write_view
from .project.findings import Findings
from .project.project import Project
from .quality.accuracy import check_accuracy
from .quality.asprs import asprs_accuracy
from .quality.cloud_comparison import Comparison, compare_to_reference
from .quality.diagnosis import Diagnosis, diagnose
from .report.record.json_schema import report_schema
from .report.record.report import Report
from .results import Adjustment
from .sfm.orientation import Orientation, OrientationSettings, orient
from .sfm.resection import Resection, resect
from .sfm.sky import find_sky
from .sfm.tie_points.detector import FeatureSettings
from .sfm.tie_points.features import find_features
from .sfm.tie_points.matching import MatchingSettings, match_pair
from .sfm.tie_points.tracks import join_matches
from .simulation.planning.flight_plan import FlightPlan
from .simulation.planning.prediction import predict_accuracy
from .simulation.simulated_survey import render_photographs, simulate
from .simulation.survey_files import write_survey
from .simulation.survey_plan import SurveyPlan
from .surface.block_surfaces import MatchedSurface, OrthophotoImage, make_orthophoto, match_surface
from .surface.contours import ContourSettings, contour_lines
from .surface.dense.tile_matching import DenseSettings
from .surface.ortho.orthophoto import OrthophotoSettings
from .surface.tin_dsm import SurfaceSettings, surface_from_points
from .survey import Block, ControlPoints, Features, Matches, Photograph, PointCloud, Raster, TiePoints
from .teaching.pair_study import PairStudy, study_pair, write_study
from .triangulation import intersect
from .verification.check import VerifiedReport, verify_report
from .volumes.surfaces import StatedSigma

__version__: str

__all__ = [
    "Adjustment",
    "AdjustmentError",
    "AdjustmentSettings",
    "AuditTables",
    "Block",
    "Camera",
    "CloudRequest",
    "Comparison",
    "ContourSettings",
    "ControlPointError",
    "ControlPoints",
    "DamagedStageError",
    "Delivered",
    "DenseSettings",
    "DetectedTargets",
    "Diagnosis",
    "Donation",
    "ExchangeError",
    "FeatureSettings",
    "Features",
    "Findings",
    "FlightPlan",
    "ForeignSolution",
    "FrameError",
    "ImageError",
    "ImportedProject",
    "LocalFrame",
    "M3C2Settings",
    "MatchedSurface",
    "Matches",
    "MatchingSettings",
    "NewProject",
    "OpenedSurvey",
    "Orientation",
    "OrientationError",
    "OrientationSettings",
    "OrthophotoImage",
    "OrthophotoSettings",
    "PairStudy",
    "PhotogramError",
    "Photograph",
    "PointCloud",
    "Pose",
    "Project",
    "ProjectError",
    "Raster",
    "Report",
    "ReportError",
    "Resection",
    "SettingError",
    "StatedSigma",
    "Stretch",
    "SurfaceError",
    "SurfaceRequest",
    "SurfaceSettings",
    "SurveyPlan",
    "TiePoints",
    "Verdict",
    "VerifiedReport",
    "WorkspaceError",
    "__version__",
    "adjust",
    "adjust_with_snooping",
    "asprs_accuracy",
    "audit",
    "calibrate_site",
    "check_accuracy",
    "check_project",
    "compare_clouds",
    "compare_files_to_reference",
    "compare_surfaces",
    "compare_to_reference",
    "contour_lines",
    "deliver",
    "detect_targets",
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
    "make_orthophoto",
    "match_pair",
    "match_surface",
    "open_survey",
    "orient",
    "predict_accuracy",
    "project_points",
    "read_cloud",
    "read_donation",
    "read_mask",
    "read_photograph",
    "read_raster",
    "read_solution",
    "render_photographs",
    "report_schema",
    "resect",
    "simulate",
    "study_pair",
    "surface_from_points",
    "unproject",
    "verify_report",
    "write_audit",
    "write_comparison",
    "write_mask",
    "write_raster",
    "write_report",
    "write_study",
    "write_survey",
    "write_view",
]
