"""The useful pairs of a block, on the pyramid level on which their rows agree."""

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.observations import ImageResiduals
from orthomill.schemas.orientation import Area, Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.parallax import matched_level, with_measured_ties
from orthomill.tasks.epipolar.selection import choose_pairs


def measured_pairs(
    block: Block,
    measured: ImageResiduals,
    photos: Photos,
    choice: PairChoice,
    height_margin: float,
    height_room: float,
    level: int | None,
    area: Area | None = None,
    wanted: WantedArea | None = None,
) -> EpipolarPairs:
    """The useful pairs (`choose_pairs`) with the rows that their tie points measured, on pyramid level `level`; None: on the finest
    one on which these agree. area: the ground that is wanted, m, or the bounds of an
    area drawn; the images of the pairs are cut to it."""
    ground = wanted.bounds if wanted else area
    coarsest = min(photos[name].levels for name in block.names) - 1

    def on(number: int) -> EpipolarPairs:
        pairs = choose_pairs(block, choice, height_margin, height_room, min(number, coarsest), ground)
        return with_measured_ties(pairs, block, measured, photos.names)

    if level is not None:
        return on(level)
    fine = on(0)
    worth = matched_level(fine)
    return on(worth) if worth else fine
