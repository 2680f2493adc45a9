"""All that the report of a calibration from chessboards is made of."""

from dataclasses import dataclass

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.board_tables import Arranged, PhotoSearch
from orthomill.tasks.calibration.solving.initial_constant import ConstantEstimate
from orthomill.tasks.calibration.solving.model_choice import HeldOut
from orthomill.tasks.calibration.solving.solving import CalibrationTarget


@dataclass(frozen=True, eq=False)
class CalibrationResults:
    """All that there is to tell; `photos` are the names of those that took part."""

    result: BoardAdjustment
    target: CalibrationTarget
    photos: list[str]
    constant: ConstantEstimate
    judged: dict[tuple[str, ...], HeldOut | None]
    searches: tuple[PhotoSearch, ...]
    arranged: Arranged

    @property
    def check(self) -> HeldOut | None:
        """The held-out check of the model that is used."""
        return self.judged[self.result.network.free]
