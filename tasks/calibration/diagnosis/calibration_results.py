"""The results from which the report of a calibration from chessboards is made."""

from dataclasses import dataclass

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.board_tables import Arranged, PhotoSearch
from orthomill.tasks.calibration.solving.initial_constant import ConstantEstimate
from orthomill.tasks.calibration.solving.lens_models import LensModel
from orthomill.tasks.calibration.solving.model_choice import HeldOut
from orthomill.tasks.calibration.solving.solving import CalibrationTarget


@dataclass(frozen=True, eq=False)
class CalibrationResults:
    """`result`: the adjustment; `photos`: names of the photographs used, by their numbers in it; `constant`: the estimate of c from
    homographies, by the same numbers; `checks`: held-out checks by model; `searches` and `arranged` of all photographs."""

    result: BoardAdjustment
    target: CalibrationTarget
    photos: list[str]
    constant: ConstantEstimate
    checks: dict[LensModel, HeldOut | None]
    searches: tuple[PhotoSearch, ...]
    arranged: Arranged

    @property
    def model(self) -> LensModel:
        """The lens model that is used."""
        return LensModel(self.result.state.lens, self.result.network.free)

    @property
    def check(self) -> HeldOut | None:
        """The held-out check of the model that is used."""
        return self.checks[self.model]
