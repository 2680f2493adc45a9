"""The explicit list of stages, in the order in which they stand in a workflow; and what can be done with a single photograph."""

from schemas.stage import Stage
from tasks.calibration.stage import CalibrationStage
from tasks.densification.stage import DensificationStage
from tasks.dsm_check.stage import DsmCheckStage
from tasks.epipolar.stage import EpipolarStage
from tasks.evaluation.stage import EvaluationStage
from tasks.inspections.window_size import Method, share_of, sizing_of, window_size_map
from tasks.orientation.stage import OrientationStage
from tasks.photos.stage import PhotosStage
from tasks.simulation.stage import SimulationStage
from tasks.texture.stage import TextureStage
from tasks.tie_points.stage import TiePointsStage

__all__ = ["STAGES", "Method", "share_of", "sizing_of", "window_size_map"]

STAGES: tuple[type[Stage], ...] = (
    SimulationStage,
    PhotosStage,
    CalibrationStage,
    TiePointsStage,
    OrientationStage,
    EpipolarStage,
    DensificationStage,
    DsmCheckStage,
    TextureStage,
    EvaluationStage,
)
