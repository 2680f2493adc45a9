"""The jobs of the stage `projection`: the mesh, what photographs see of it, the outputs, the coloured mesh and the proof."""

from collections.abc import Iterator
from itertools import islice

from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import PhotoFolder
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import ProjectView
from orthomill.tasks.colouring.blending.colour_rules import colour_rules_of
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth, WideningRules
from orthomill.tasks.projection.photographs.chosen_photographs import PhotographMask, masks_of, taking_part
from orthomill.tasks.projection.plan.frame_jobs import FrameJobs, surfaces_job
from orthomill.tasks.projection.plan.mesh_jobs import block_jobs, facing_job, frames_job, line_jobs, mesh_job
from orthomill.tasks.projection.plan.model_jobs import ModelJobs
from orthomill.tasks.projection.plan.output_jobs import OutputJobs
from orthomill.tasks.projection.plan.photograph_jobs import border_jobs, photograph_jobs, picture_jobs
from orthomill.tasks.projection.plan.projection_tables import (
    BLOCKS,
    CENSUS,
    FACING,
    FRAMES,
    SURFACES,
    WIDENING,
    border_layer,
    border_table,
    depth_table,
)
from orthomill.tasks.projection.plan.proof_jobs import left_out_frames, proof_jobs
from orthomill.tasks.projection.plan.result_jobs import product_exports, report_job, sample_jobs, width_jobs
from orthomill.tasks.projection.projection_basis import ProjectionBasis
from orthomill.tasks.projection.report.projection_report import PICTURED
from orthomill.tasks.projection.stage import ProjectionStage, WidenLimits
from orthomill.tasks.projection.tiles.width_trials import WIDTHS
from orthomill.tasks.visibility.mesh_blocks import PhotoDepth
from orthomill.tasks.visibility.mesh_sight import SightTolerance


def projection_jobs(asked: ProjectionStage, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
    """The mesh in blocks, depth rasters, sight, limits and balance, then the tiles of the outputs and the proof.

    Planning waits three times: for the mesh (how many blocks it has), for the frames, and for the depth rasters, which tell the
    blocks and photographs that a tile needs.
    """
    block, photos = view.table(BLOCK), view.table(PHOTOS)
    names = taking_part(block.names, asked.without)
    yield mesh_job(view, asked.surface)
    census = view.table(CENSUS)
    yield from block_jobs(census)
    yield frames_job(asked.outputs, names, asked.surface.unit)
    frames, blocks = view.table(FRAMES).frames, view.table(BLOCKS)
    basis = ProjectionBasis(
        block=block, photos=photos, names=names, census=census, blocks=blocks, tile=view.project.tile, crs=block.crs
    )
    yield from photograph_jobs(basis)
    if asked.masks.kind == "borders":
        yield from border_jobs(basis)
    yield facing_job(names, asked.surface.faces)
    sections = {output.name: output.section for output in asked.outputs}
    shown = [FrameJobs(basis, frame, sections[frame.name]) for frame in frames]
    again = list(_left_out(asked, basis))
    for jobs in (*shown, *again):
        yield from jobs.depth()
    yield surfaces_job((*shown, *again))
    # First what is made from all photographs and from all tiles: asked for one by one, each would be a reason to plan again.
    _, surfaces = view.table(FACING), iter(view.table(SURFACES).tiles)
    masks = _masks(asked, view, basis)
    seen = {name: view.table(depth_table(name)) for name in names}
    outputs = [OutputJobs(jobs, tuple(islice(surfaces, len(jobs.tiles))), seen, masks) for jobs in shown]
    proofs = [OutputJobs(jobs, tuple(islice(surfaces, len(jobs.tiles))), seen, masks) for jobs in again]
    model = _model(asked, view, basis, seen, masks)
    yield from _coloured(asked, view, outputs, proofs, names)
    if asked.depth_pictures:
        yield from picture_jobs(basis)
        for output in outputs:
            yield from output.depth_pictures()
    if model:
        yield from model.jobs(_tolerance(asked), colour_rules_of(asked), _width(asked))
    yield report_job(outputs, proofs, model, _width(asked), names[:PICTURED] if asked.depth_pictures else ())
    yield from product_exports(outputs)
    yield from line_jobs(asked.section_lines, len(blocks.boxes))


def _coloured(
    asked: ProjectionStage, view: ProjectView, outputs: list[OutputJobs], proofs: list[OutputJobs], names: tuple[str, ...]
) -> Iterator[RasterSpec | Job]:
    """The colours of all outputs, before them the balance and how wide the zone next to limits is; and the proofs."""
    yield from sample_jobs(view, asked, outputs, names, _tolerance(asked))
    if asked.widening.kind == "limits":
        yield from width_jobs(outputs, _widening_rules(asked.widening), asked.widening.dilation, colour_rules_of(asked))
    for output in outputs:
        yield from output.colours(colour_rules_of(asked), _width(asked))
    for proof in proofs:
        yield from proof_jobs(proof, _tolerance(asked), colour_rules_of(asked), _width(asked))


def _left_out(asked: ProjectionStage, basis: ProjectionBasis) -> Iterator[FrameJobs]:
    """The photographs that are made again."""
    if asked.leave_one_out.kind == "photographs":
        yield from left_out_frames(basis, asked.leave_one_out.most, asked.leave_one_out.pixels)


def _model(
    asked: ProjectionStage, view: ProjectView, basis: ProjectionBasis, seen: dict[str, PhotoDepth], masks: dict[str, PhotographMask]
) -> ModelJobs | None:
    if asked.model.kind == "none":
        return None
    texel = view.table(FRAMES).pixel if asked.model.texel == "auto" else asked.model.texel
    return ModelJobs(basis, seen, masks, texel, asked.model.side, view.project.project)


def _tolerance(asked: ProjectionStage) -> SightTolerance:
    return SightTolerance(asked.sight.depth, asked.sight.rough, asked.sight.break_at)


def _width(asked: ProjectionStage) -> Table[ChosenWidth] | None:
    """Which of the zones next to limits are used."""
    return WIDENING if asked.widening.kind == "limits" else None


def _masks(asked: ProjectionStage, view: ProjectView, basis: ProjectionBasis) -> dict[str, PhotographMask]:
    if asked.masks.kind == "none":
        return {}
    if asked.masks.kind == "borders":
        shares = {name: view.table(border_table(name)).share for name in basis.names}
        return {name: PhotographMask(raster=border_layer(name)) for name, share in shares.items() if share > 0}
    return masks_of(view.image_files(PhotoFolder(kind="folder", path=asked.masks.path)), basis.photos, basis.names)


def _widening_rules(widening: WidenLimits) -> WideningRules:
    """The zones that are drawn."""
    widths = WIDTHS if widening.dilation == "auto" else (widening.dilation,)
    return WideningRules(widening.window, widening.speck, widths)
