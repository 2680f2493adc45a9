"""What a job that orients a block hands back, by whichever way it was oriented."""

from typing import NamedTuple

from orthomill.schemas.observations import GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block, BlockPrecision, GroundResiduals, SeparateBlocks


class BlockTables(NamedTuple):
    """The tables of a block. `separate`: blocks without a place in the project's system; a fixed block has none."""

    block: Block
    points: GroundPoints
    image_residuals: ImageResiduals
    ground_residuals: GroundResiduals
    precision: BlockPrecision
    separate: SeparateBlocks | None = None
