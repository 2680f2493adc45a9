"""The jobs that prove the block: photographs made again from the others, and compared with themselves."""

from collections.abc import Iterator

from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.projection.frames.projection_frames import left_out_frame
from orthomill.tasks.projection.lines.sections import NoSection
from orthomill.tasks.projection.photographs.chosen_photographs import left_out_names
from orthomill.tasks.projection.photographs.leave_one_out import compare_left_out
from orthomill.tasks.projection.plan.frame_jobs import FrameJobs
from orthomill.tasks.projection.plan.output_jobs import OutputJobs
from orthomill.tasks.projection.plan.projection_tables import RADIOMETRY, left_out_table, output_layer
from orthomill.tasks.projection.projection_basis import ProjectionBasis
from orthomill.tasks.visibility.mesh_sight import SightTolerance


def left_out_frames(basis: ProjectionBasis, most: int, pixels: int) -> Iterator[FrameJobs]:
    """The frames of at most `most` photographs that are made again, in pictures of at most so many `pixels`."""
    if len(basis.names) > 1:
        for name in left_out_names(basis.names, most):
            frame = left_out_frame(basis.block, name, basis.names.index(name), pixels, basis.photos[name].levels)
            yield FrameJobs(basis, frame, NoSection())


def proof_jobs(
    output: OutputJobs, tolerance: SightTolerance, rules: ColourRules, widening: Table[ChosenWidth] | None
) -> Iterator[RasterSpec | Job]:
    """A photograph made again from the others, and compared with itself."""
    yield from output.sight(tolerance)
    yield from output.left_out(rules, widening)
    frame = output.frame.frame
    (name,) = frame.without
    photo, whole = output.basis.photos[name], Window(0, 0, *frame.shape)
    level = next(k for k in range(photo.levels) if level_shape((photo.height, photo.width), k) == frame.shape)
    yield output.frame.raster("difference", "uint8", unit="grey levels")
    yield Job(
        stage="projection",
        item=f"{frame.name}-compare",
        function=compare_left_out,
        reads={
            "blended": Raster(output_layer(frame.name, "blended"), whole),
            "nearest": Raster(output_layer(frame.name, "nearest"), whole),
            "pixels": Raster(photo_raster(name, level), whole),
            "radiometry": RADIOMETRY,
        },
        writes={"result": left_out_table(frame.name), "difference": Raster(output_layer(frame.name, "difference"), whole)},
        params={"name": name},
        scratch=array_bytes(120, frame.rows, frame.cols),
    )
