"""The explicit list of stages, in the order in which they stand in a workflow; their settings, without their methods."""

from orthomill.schemas.stage_contract import Stage
from orthomill.tasks.accuracy.stage import AccuracyStage
from orthomill.tasks.calibration.stage import CalibrationStage
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.evaluation.stage import EvaluationStage
from orthomill.tasks.orientation.stage import OrientationStage
from orthomill.tasks.photos.stage import PhotosStage
from orthomill.tasks.projection.stage import ProjectionStage
from orthomill.tasks.registration.stage import RegistrationStage
from orthomill.tasks.simulation.stage import SimulationStage
from orthomill.tasks.terrain.stage import TerrainStage
from orthomill.tasks.texture.stage import TextureStage
from orthomill.tasks.tie_points.stage import TiePointsStage
from orthomill.tasks.viewer.stage import ViewerStage

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
