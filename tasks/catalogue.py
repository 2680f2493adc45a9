"""The explicit list of stages, in the order in which they stand in a workflow; and what can be done with one photograph or two."""

from orthomill.schemas.stage_contract import Stage
from orthomill.tasks.accuracy.acceptance.clauses import accepted
from orthomill.tasks.accuracy.acceptance.delivered_points import SurveyedPoint, inspected
from orthomill.tasks.accuracy.adjustment.joint_covariance import StoredCovariance
from orthomill.tasks.accuracy.answers.measuring import measure
from orthomill.tasks.accuracy.stage import AccuracyStage
from orthomill.tasks.accuracy.statement.point_statement import statement_of
from orthomill.tasks.calibration.stage import CalibrationStage
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.evaluation.stage import EvaluationStage
from orthomill.tasks.flight_outlook import look_ahead
from orthomill.tasks.inspections.image_points import points_on_surface
from orthomill.tasks.inspections.window_size import share_of, sizing_of, window_size_map
from orthomill.tasks.marking.given_points import given_points, marks_of
from orthomill.tasks.marking.marker import marker_of
from orthomill.tasks.orientation.relative.classical_forms import classical_forms
from orthomill.tasks.orientation.stage import OrientationStage
from orthomill.tasks.photos.stage import PhotosStage
from orthomill.tasks.projection.stage import ProjectionStage
from orthomill.tasks.registration.stage import RegistrationStage
from orthomill.tasks.simulation.stage import SimulationStage
from orthomill.tasks.terrain.stage import TerrainStage
from orthomill.tasks.texture.stage import TextureStage
from orthomill.tasks.tie_points.stage import TiePointsStage
from orthomill.tasks.viewer.stage import ViewerStage

__all__ = [
    "STAGES",
    "StoredCovariance",
    "SurveyedPoint",
    "accepted",
    "classical_forms",
    "given_points",
    "inspected",
    "look_ahead",
    "marker_of",
    "marks_of",
    "measure",
    "points_on_surface",
    "share_of",
    "sizing_of",
    "statement_of",
    "window_size_map",
]

STAGES: tuple[type[Stage], ...] = (
    SimulationStage,
    PhotosStage,
    CalibrationStage,
    RegistrationStage,
    TiePointsStage,
    OrientationStage,
    EpipolarStage,
    DensificationStage,
    DsmCheckStage,
    TerrainStage,
    TextureStage,
    ViewerStage,
    ProjectionStage,
    AccuracyStage,
    EvaluationStage,
)
