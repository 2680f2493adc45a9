"""All that the report of a calibration from chessboards is made of."""

from dataclasses import dataclass

from tasks.adjustment.board_bundle import BoardAdjustment
from tasks.calibration.initial_constant import ConstantEstimate
from tasks.calibration.judgement import HeldOut
from tasks.calibration.solving import Target
from tasks.calibration.tables import Arranged, PhotoSearch


@dataclass(frozen=True, eq=False)
class Account:
    """All that there is to tell; `photos` are the names of those that took part."""

    result: BoardAdjustment
    target: Target
    photos: list[str]
    constant: ConstantEstimate
    judged: dict[tuple[str, ...], HeldOut | None]
    searches: tuple[PhotoSearch, ...]
    arranged: Arranged

    @property
    def check(self) -> HeldOut | None:
        """The held-out check of the model that is used."""
        return self.judged[self.result.network.free]
