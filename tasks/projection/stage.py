"""The stage `projection`: a solid surface on maps, walls, cylinders and views, coloured from every photograph that sees it."""

from collections.abc import Iterator
from itertools import islice
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import PhotoFolder
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.tasks.colouring.colour_settings import AverageTwo, ColourSettings, PreferUnbroken
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth, WideningRules
from orthomill.tasks.projection.lines.section_line import SectionLine
from orthomill.tasks.projection.outputs import MapOutput, Output
from orthomill.tasks.projection.photographs.chosen_photographs import (
    BorderMasks,
    LeaveOneOut,
    LeavingOut,
    Masks,
    PhotographMask,
    masks_of,
    taking_part,
)
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
from orthomill.tasks.projection.surface_source import SolidSurface
from orthomill.tasks.projection.tiles.width_trials import WIDTHS
from orthomill.tasks.visibility.mesh_blocks import PhotoDepth
from orthomill.tasks.visibility.mesh_sight import SightTolerance


class NoWidening(Settings):
    """Colours are used up to the very limit of what is hidden."""

    kind: Literal["none"]


class WidenLimits(Settings):
    """Next to the limits of what a photograph does not see its colours serve only where there are no others."""

    kind: Literal["limits"] = "limits"
    window: int = setting(
        2, "Side of the window that opens what is hidden: specks smaller than it have no limits.", "px", ge=1, le=31
    )
    speck: int = setting(12, "Hidden specks of fewer pixels of the output are ignored.", "px", ge=0, le=10_000)
    dilation: Annotated[float, Field(ge=0, le=200)] | Literal["auto"] = setting(
        "auto",
        "Width of the zone in the photographs, on either side: the precision of mesh and orientation there. auto: the one of 1, 2, "
        "3, 5 px whose colours are nearest to those of photographs that are left out there; none where none is better.",
        "px",
    )

    @property
    def rules(self) -> WideningRules:
        """The zones that are drawn."""
        return WideningRules(self.window, self.speck, WIDTHS if self.dilation == "auto" else (self.dilation,))


class SightSettings(Settings):
    """How exactly a photograph must show a place to see it, in its own pixels on the surface."""

    depth: float = setting(1.0, "How deep a ray may dip into another triangle before it counts as hidden.", "px", ge=0)
    rough: float = setting(3.0, "The same where triangles are smaller than a pixel, so that none is met exactly.", "px", ge=0)
    break_at: float = setting(20.0, "Difference of neighbouring depths from which one hides the other.", "px", gt=0)


class NoModel(Settings):
    """No coloured mesh is made."""

    kind: Literal["none"]


class TexturedModel(Settings):
    """The mesh with a texture for each part of it, from every photograph that sees it; coarser levels where it is large."""

    kind: Literal["tiles"] = "tiles"
    texel: Annotated[float, Field(gt=0)] | Literal["auto"] = setting(
        "auto", "Side of a texel. auto: that of a pixel of the photographs on the surface.", "m"
    )
    side: int = setting(
        2048,
        "Longest side of a texture; where it does not suffice for 16384 triangles, their texels are larger.",
        "px",
        ge=64,
        le=8192,
    )


TwoValues = Annotated[AverageTwo | PreferUnbroken, Field(discriminator="kind")]
Widening = Annotated[NoWidening | WidenLimits, Field(discriminator="kind")]
Model = Annotated[NoModel | TexturedModel, Field(discriminator="kind")]


class ProjectionStage(ColourSettings, Stage):
    """Projects a triangle mesh onto maps, walls, cylinders and views, each pixel coloured from all photos that really see it."""

    title: ClassVar[str] = "Projections of the surface"

    kind: Literal["projection"] = "projection"
    surface: SolidSurface = setting(..., "The surface.")
    outputs: tuple[Output, ...] = setting((MapOutput(),), "What it is projected onto.", min_length=1)
    without: tuple[str, ...] = setting((), "Shell patterns of names of photographs that take no part.")
    masks: Masks = setting(BorderMasks(), "Parts of the photographs that are not used.")
    sight: SightSettings = setting(SightSettings(), "How exactly the visibility is tested.")
    two_colours: TwoValues = setting(PreferUnbroken(), "What happens where exactly two photos see the surface and disagree.")
    widening: Widening = setting(WidenLimits(), "What happens next to the limits of what is hidden.")
    best: Annotated[int, Field(ge=0, le=64)] | Literal["auto"] = setting(
        "auto",
        "Number of photos of the greatest weight that are blended; 0 for all. auto: those whose pixels on the surface are not much "
        "larger than the finest ones; the others fade out and only help to find gross errors.",
    )
    section_lines: tuple[SectionLine, ...] = setting((), "Planes whose lines of intersection with the surface are drawn.")
    model: Model = setting(TexturedModel(), "The coloured mesh to take away.")
    depth_pictures: bool = setting(True, "Whether the depths of photos and outputs are also saved as pictures.")
    leave_one_out: LeavingOut = setting(LeaveOneOut(), "Whether the photos are made again from each other, as a proof.")

    @model_validator(mode="after")
    def _names_differ(self) -> "ProjectionStage":
        names = [output.name for output in self.outputs]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"outputs: {', '.join(twice)} is the name of several outputs; give each its own")
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """The mesh in blocks, depth rasters, sight, limits and balance, then the tiles of the outputs and the proof.

        Planning waits three times: for the mesh (how many blocks it has), for the frames, and for the depth rasters, which tell the
        blocks and photographs that a tile needs.
        """
        block, photos = view.table(BLOCK), view.table(PHOTOS)
        names = taking_part(block.names, self.without)
        yield mesh_job(view, self.surface)
        census = view.table(CENSUS)
        yield from block_jobs(census)
        yield frames_job(self.outputs, names, self.surface.unit)
        frames, blocks = view.table(FRAMES).frames, view.table(BLOCKS)
        basis = ProjectionBasis(
            block=block, photos=photos, names=names, census=census, blocks=blocks, tile=view.project.tile, crs=block.crs
        )
        yield from photograph_jobs(basis)
        if self.masks.kind == "borders":
            yield from border_jobs(basis)
        yield facing_job(names, self.surface.faces)
        sections = {output.name: output.section for output in self.outputs}
        shown = [FrameJobs(basis, frame, sections[frame.name]) for frame in frames]
        again = list(self._left_out(basis))
        for jobs in (*shown, *again):
            yield from jobs.depth()
        yield surfaces_job((*shown, *again))
        # First what is made from all photographs and from all tiles: asked for one by one, each would be a reason to plan again.
        _, surfaces = view.table(FACING), iter(view.table(SURFACES).tiles)
        masks = self._masks(view, basis)
        seen = {name: view.table(depth_table(name)) for name in names}
        outputs = [OutputJobs(jobs, tuple(islice(surfaces, len(jobs.tiles))), seen, masks) for jobs in shown]
        proofs = [OutputJobs(jobs, tuple(islice(surfaces, len(jobs.tiles))), seen, masks) for jobs in again]
        model = self._model(view, basis, seen, masks)
        yield from self._coloured(view, outputs, proofs, names)
        if self.depth_pictures:
            yield from picture_jobs(basis)
            for output in outputs:
                yield from output.depth_pictures()
        if model:
            yield from model.jobs(self._tolerance, self.colour_rules, self._width)
        yield report_job(outputs, proofs, model, self._width, names[:PICTURED] if self.depth_pictures else ())
        yield from product_exports(outputs)
        yield from line_jobs(self.section_lines, len(blocks.boxes))

    def _coloured(
        self, view: ProjectView, outputs: list[OutputJobs], proofs: list[OutputJobs], names: tuple[str, ...]
    ) -> Iterator[RasterSpec | Job]:
        """The colours of all outputs, before them the balance and how wide the zone next to limits is; and the proofs."""
        yield from sample_jobs(view, self, outputs, names, self._tolerance)
        if self.widening.kind == "limits":
            yield from width_jobs(outputs, self.widening.rules, self.widening.dilation, self.colour_rules)
        for output in outputs:
            yield from output.colours(self.colour_rules, self._width)
        for proof in proofs:
            yield from proof_jobs(proof, self._tolerance, self.colour_rules, self._width)

    def _left_out(self, basis: ProjectionBasis) -> Iterator[FrameJobs]:
        """The photographs that are made again."""
        if self.leave_one_out.kind == "photographs":
            yield from left_out_frames(basis, self.leave_one_out.most, self.leave_one_out.pixels)

    def _model(
        self, view: ProjectView, basis: ProjectionBasis, seen: dict[str, PhotoDepth], masks: dict[str, PhotographMask]
    ) -> ModelJobs | None:
        if self.model.kind == "none":
            return None
        texel = view.table(FRAMES).pixel if self.model.texel == "auto" else self.model.texel
        return ModelJobs(basis, seen, masks, texel, self.model.side, view.project.project)

    @property
    def _tolerance(self) -> SightTolerance:
        return SightTolerance(self.sight.depth, self.sight.rough, self.sight.break_at)

    @property
    def _width(self) -> Table[ChosenWidth] | None:
        """Which of the zones next to limits are used."""
        return WIDENING if self.widening.kind == "limits" else None

    def _masks(self, view: ProjectView, basis: ProjectionBasis) -> dict[str, PhotographMask]:
        if self.masks.kind == "none":
            return {}
        if self.masks.kind == "borders":
            shares = {name: view.table(border_table(name)).share for name in basis.names}
            return {name: PhotographMask(raster=border_layer(name)) for name, share in shares.items() if share > 0}
        return masks_of(view.image_files(PhotoFolder(kind="folder", path=self.masks.path)), basis.photos, basis.names)
