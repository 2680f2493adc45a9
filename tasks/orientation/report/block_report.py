"""What a surveyor reads about the block: precision, reliability, fit to control and positions, and what is poorly determined."""

from orthomill.schemas.camera import Cameras
from orthomill.schemas.observations import Control, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block, BlockPrecision, GroundResiduals, RelativeOrientations
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import StageReport
from orthomill.tasks.orientation.examined.block_facts import Facts
from orthomill.tasks.orientation.report.adjustment_tables import adjustment_grids, ground_grids
from orthomill.tasks.orientation.report.block_answers import PRODUCTS, block_answers, block_evidence, block_lengths, block_verdict
from orthomill.tasks.orientation.report.block_charts import block_charts
from orthomill.tasks.orientation.report.block_doubts import block_doubts
from orthomill.tasks.orientation.report.block_figures import block_figures
from orthomill.tasks.orientation.report.block_warnings import block_losses, block_warnings
from orthomill.tasks.orientation.report.camera_tables import camera_grids
from orthomill.tasks.orientation.report.overlap_picture import overlap_picture
from orthomill.tasks.orientation.report.photograph_tables import photograph_grids


def report(
    photos: Photos,
    cameras: Cameras,
    control: Control,
    relative: RelativeOrientations,
    block: Block,
    points: GroundPoints,
    image_residuals: ImageResiduals,
    ground_residuals: GroundResiduals,
    precision: BlockPrecision,
    on_plane: Block | None = None,
) -> StageReport:
    """The stage's report; `cameras` as they were before the adjustment; `on_plane`: the block in the system of the plane on which
    the surface stands, where it stands on one."""
    facts = Facts(
        photos=photos,
        before=cameras,
        control=control,
        relative=relative,
        block=block,
        points=points,
        image=image_residuals,
        ground=ground_residuals,
        precision=precision,
    )
    grids = (
        *camera_grids(facts),
        *ground_grids(ground_residuals),
        *adjustment_grids(precision, ground_residuals.distances),
        *photograph_grids(facts),
    )
    doubts = tuple(block_doubts(facts))
    return StageReport(
        verdict=block_verdict(facts, doubts),
        answers=tuple(block_answers(facts)),
        products=PRODUCTS,
        evidence=tuple(block_evidence(facts)),
        figures=block_figures(facts),
        grids=tuple(grid for grid in grids if grid.rows),
        charts=tuple(block_charts(facts)),
        pictures=(overlap_picture(on_plane or block),),
        warnings=tuple(block_warnings(facts)),
        doubts=doubts,
        losses=tuple(block_losses(facts)),
        lengths=block_lengths(facts),
    )
