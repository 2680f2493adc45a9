"""The stage `projection`: a solid surface on maps, walls, cylinders and views, coloured from every photograph that sees it."""

from collections.abc import Iterator
from itertools import islice
from math import ceil, sqrt
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from orthomill.schemas.job import Export, Job, MeshFile, Raster, Reading, Stream, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.project import PhotoFolder
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.solid.census import MeshCensus, MeshTriangles, MeshVertices
from orthomill.schemas.solid.frames import FlatFrame, OutputFrames, ViewFrame
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import CORRECTED, HEIGHT, SURFACE
from orthomill.tasks.colouring.blending.blending import Blend
from orthomill.tasks.colouring.colour_settings import (
    AboutMean,
    AverageTwo,
    Balance,
    BlockBalance,
    ByArea,
    PreferUnbroken,
    Rejections,
    Weights,
    power_of,
    rejection_of,
)
from orthomill.tasks.colouring.sight.facing import mesh_facing
from orthomill.tasks.colouring.surface_colours import PROJECTION_RADIOMETRY, ColourRules, balance_surface
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth, WideningRules
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.projection.chosen_photographs import (
    BorderMasks,
    LeaveOneOut,
    LeavingOut,
    Masks,
    PhotographMask,
    left_out_names,
    masks_of,
    taking_part,
)
from orthomill.tasks.projection.depth_rasters import cut_into_blocks
from orthomill.tasks.projection.leave_one_out import LeftOutPhotograph, compare_left_out
from orthomill.tasks.projection.lines.section_line import LineText, SectionLine, draw_section
from orthomill.tasks.projection.lines.sections import NoSection
from orthomill.tasks.projection.mesh_mending import mend_heights, mend_mesh
from orthomill.tasks.projection.model.model_jobs import Model, ModelJobs, TexturedModel
from orthomill.tasks.projection.outputs import MapOutput, Output
from orthomill.tasks.projection.projection_frames import left_out_frame, output_frames
from orthomill.tasks.projection.projection_jobs import (
    BLOCKS,
    CENSUS,
    CORNERS,
    FACING,
    SURFACES,
    ColourJobs,
    FrameJobs,
    ProjectionBasis,
    block_window,
    border_jobs,
    border_layer,
    border_table,
    depth_table,
    output_layer,
    photograph_jobs,
    photograph_picture,
    samples_table,
    statistics_table,
    surfaces_job,
)
from orthomill.tasks.projection.report import PICTURED, projection_report
from orthomill.tasks.projection.reporting.output_doubts import degrees_before
from orthomill.tasks.projection.reporting.output_totals import OutputFacts
from orthomill.tasks.projection.surface_source import HeightModelSurface, SolidSurface
from orthomill.tasks.projection.widening.widening_jobs import WIDENING, WideningJobs, choice
from orthomill.tasks.projection.widening.width_trials import WIDTHS
from orthomill.tasks.visibility.mesh_blocks import PhotoDepth
from orthomill.tasks.visibility.mesh_sight import SightTolerance
from orthomill.tasks.visibility.triangle_blocks import SIDE, block_count

VERTICES = Table("projection/vertices.parquet", MeshVertices)
TRIANGLES = Table("projection/triangles.parquet", MeshTriangles)
FRAMES = Table("projection/frames.json", OutputFrames)
_SCAN = "photographs/scan.ply"  # what the stage `simulation` writes
SAMPLES_AT_MOST = 60_000
"""Samples of all outputs for the radiometric balance."""
_SPACING_OF_RANGE = 64  # px between samples that serve for the range of 16 bits only


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
        "Width of the zone in the photographs, on either side: what mesh and orientation are worth there. auto: the one of 1, 2, "
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


TwoValues = Annotated[AverageTwo | PreferUnbroken, Field(discriminator="kind")]
Widening = Annotated[NoWidening | WidenLimits, Field(discriminator="kind")]


class ProjectionStage(Stage):
    """Projects a triangle mesh onto maps, walls, cylinders and views, each pixel coloured from all photos that really see it."""

    title: ClassVar[str] = "Projections of the surface"

    kind: Literal["projection"] = "projection"
    surface: SolidSurface = setting(..., "The surface.")
    outputs: tuple[Output, ...] = setting((MapOutput(),), "What it is projected onto.", min_length=1)
    without: tuple[str, ...] = setting((), "Shell patterns of names of photographs that take no part.")
    masks: Masks = setting(BorderMasks(), "Parts of the photographs that are not used.")
    sight: SightSettings = setting(SightSettings(), "How exactly the visibility is tested.")
    weights: Weights = setting(ByArea(), "Weight of a photo's colour (Petsa et al. 2007).")
    rejection: Rejections = setting(AboutMean(), "Which colours are rejected as gross errors.")
    two_colours: TwoValues = setting(PreferUnbroken(), "What happens where exactly two photos see the surface and disagree.")
    widening: Widening = setting(WidenLimits(), "What happens next to the limits of what is hidden.")
    best: Annotated[int, Field(ge=0, le=64)] | Literal["auto"] = setting(
        "auto",
        "Number of photos of the greatest weight that are blended; 0 for all. auto: those whose pixels on the surface are not much "
        "larger than the finest ones; the others fade out and only help to find gross errors.",
    )
    balance: Balance = setting(BlockBalance(), "How the photos are adjusted to one brightness.")
    feather: float = setting(
        0.15, "Width of the border of a photo in which its weight rises from 0, as a share of its shorter side.", ge=0, le=0.5
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
        """The mesh in blocks, depth rasters, sight, limits and balance, then the tiles of the outputs and the proof."""
        block, photos = view.table(BLOCK), view.table(PHOTOS)
        names = taking_part(block.names, self.without)
        yield self._mending(view)
        census = view.table(CENSUS)
        yield from self._cutting(census)
        yield self._framing(names)
        frames, blocks = view.table(FRAMES).frames, view.table(BLOCKS)
        basis = ProjectionBasis(block, photos, names, census, blocks, view.project.tile, block.crs)
        yield from photograph_jobs(basis)
        if self.masks.kind == "borders":
            yield from border_jobs(basis)
        yield self._facing(names)
        sections = {output.name: output.section for output in self.outputs}
        outputs = [FrameJobs(basis, frame, sections[frame.name]) for frame in frames]
        proofs = [FrameJobs(basis, frame, NoSection()) for frame in self._left_out(basis)]
        for jobs in (*outputs, *proofs):
            yield from jobs.depth()
        yield surfaces_job((*outputs, *proofs))
        # First what is made from all photographs and from all tiles: asked for one by one, each would be a reason to plan again.
        _, shown = view.table(FACING), view.table(SURFACES)
        masks = self._masks(view, basis)
        seen, surfaces = {name: view.table(depth_table(name)) for name in names}, iter(shown.tiles)
        coloured = [ColourJobs(jobs, tuple(islice(surfaces, len(jobs.tiles))), seen, masks) for jobs in (*outputs, *proofs)]
        yield from self._sampled(view, coloured[: len(outputs)], basis)
        yield from self._outputs(coloured[: len(outputs)])
        for colour in coloured[len(outputs) :]:
            yield from self._proof(colour)
        if self.depth_pictures:
            for name in names:
                yield from photograph_picture(basis, name)
            for colour in coloured[: len(outputs)]:
                yield from colour.depth_pictures()
        model = self._model(view, basis, seen, masks)
        if model:
            yield from model.jobs(self._tolerance, self._rules(), self._widening)
        yield from self._results(coloured, len(outputs), basis, model)
        yield from self._lines(basis)

    def _lines(self, basis: ProjectionBasis) -> Iterator[Job | Export]:
        """The section lines as DXF and GeoJSON."""
        every = Stream(tuple(Raster(CORNERS, block_window(k)) for k in range(len(basis.blocks.boxes))))
        for line in self.section_lines:
            tables = {kind: Table(f"projection/lines/{line.name}-{kind}.json", LineText) for kind in ("dxf", "geojson")}
            reads: dict[str, Reading] = {"blocks": every, "census": CENSUS}
            yield Job("projection", f"line-{line.name}", draw_section, reads, dict(tables), {"line": line}, scratch=256 * 2**20)
            for kind, table in tables.items():
                yield Export("projection", f"{line.name}-{kind}", f"products/{line.name}.{kind}", "text", tables=(table,))

    def _mending(self, view: ProjectView) -> Job:
        surface = self.surface
        if isinstance(surface, HeightModelSurface):
            return self._height_mesh(view, surface.every)
        path = view.run_file(_SCAN) if surface.kind == "simulated" else surface.path
        return Job(
            "projection",
            "mesh",
            mend_mesh,
            {"mesh": MeshFile(path)},
            {"vertices": VERTICES, "triangles": TRIANGLES, "census": CENSUS},
            {"unit": surface.unit, "shift": surface.shift, "y_up": surface.y_up, "systems": (surface.crs, view.project.crs)},
            scratch=512 * 2**20,
            way_out="decimate the mesh",
        )

    def _height_mesh(self, view: ProjectView, every: int) -> Job:
        """The surface model of the project as a mesh."""
        heights = CORRECTED if view.has_stage("dsm_check") else HEIGHT
        grid = view.table(SURFACE).grid
        return Job(
            "projection",
            "mesh",
            mend_heights,
            {"heights": Raster(view.raster(heights).name, Window(0, 0, *grid.shape))},
            {"vertices": VERTICES, "triangles": TRIANGLES, "census": CENSUS},
            {"grid": grid, "every": every},
            scratch=700 * grid.rows * grid.cols // every**2,
            way_out="set a larger 'every' of the surface",
        )

    def _cutting(self, census: MeshCensus) -> Iterator[RasterSpec | Job]:
        blocks = block_count(census.triangles)
        spec = RasterSpec(name=CORNERS, shape=(blocks * SIDE, SIDE, 9), dtype="float32", chunk=SIDE, unit="m")
        yield spec
        yield Job(
            "projection",
            "blocks",
            cut_into_blocks,
            {"vertices": VERTICES, "triangles": TRIANGLES},
            {"corners": Raster(CORNERS, spec.full), "boxes": BLOCKS},
            {},
            scratch=60 * census.vertices + 150 * census.triangles,
        )

    def _framing(self, names: tuple[str, ...]) -> Job:
        reads: dict[str, Reading] = {"vertices": VERTICES, "triangles": TRIANGLES, "census": CENSUS, "block": BLOCK}
        params = {"outputs": self.outputs, "taking_part": names, "unit": self.surface.unit}
        return Job("projection", "frames", output_frames, reads, {"frames": FRAMES}, params, scratch=256 * 2**20)

    def _facing(self, names: tuple[str, ...]) -> Job:
        reads: dict[str, Reading] = {"seen": tuple(depth_table(name) for name in names)}
        return Job("projection", "facing", mesh_facing, reads, {"facing": FACING}, {"names": names, "faces": self.surface.faces})

    def _left_out(self, basis: ProjectionBasis) -> Iterator[ViewFrame]:
        """The frames of the photographs that are made again."""
        if self.leave_one_out.kind == "photographs" and len(basis.names) > 1:
            for name in left_out_names(basis.names, self.leave_one_out.most):
                levels = basis.photos[name].levels
                yield left_out_frame(basis.block, name, basis.names.index(name), self.leave_one_out.pixels, levels)

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
    def _widening(self) -> Table[ChosenWidth] | None:
        return WIDENING if self.widening.kind == "limits" else None

    def _masks(self, view: ProjectView, basis: ProjectionBasis) -> dict[str, PhotographMask]:
        if self.masks.kind == "none":
            return {}
        if self.masks.kind == "borders":
            shares = {name: view.table(border_table(name)).share for name in basis.names}
            return {name: PhotographMask(raster=border_layer(name)) for name, share in shares.items() if share > 0}
        return masks_of(view.image_files(PhotoFolder(kind="folder", path=self.masks.path)), basis.photos, basis.names)

    def _sampled(self, view: ProjectView, outputs: list[ColourJobs], basis: ProjectionBasis) -> Iterator[RasterSpec | Job]:
        """How photographs see all outputs, samples and the balance."""
        first = 0
        for colour in outputs:
            frame = colour.frame.frame
            yield from colour.sight(self._tolerance)
            yield from colour.samples(self._spacing(frame.rows * frame.cols * len(outputs)), first)
            first += frame.rows * frame.cols
        tables = tuple(samples_table(colour.frame.name, tile) for colour in outputs for tile in colour.frame.tiles)
        deep = any(view.raster(photo_raster(name, 0)).dtype == "uint16" for name in basis.names)
        vignetting = self.balance.kind == "block" and self.balance.vignetting
        yield Job(
            "projection",
            "balance",
            balance_surface,
            {"samples": tables, "block": BLOCK},
            {"radiometry": PROJECTION_RADIOMETRY},
            {"deep": deep, "method": self.balance.kind, "vignetting": vignetting},
            scratch=250 * SAMPLES_AT_MOST * min(len(basis.names), 12),
        )

    def _spacing(self, pixels: int) -> int:
        """px between samples: that of the setting, or as many as keep to SAMPLES_AT_MOST."""
        wanted = self.balance.spacing if self.balance.kind != "none" else _SPACING_OF_RANGE
        return max(wanted, ceil(sqrt(pixels / SAMPLES_AT_MOST)))

    def _rules(self) -> ColourRules:
        breaks = self.two_colours.kind == "depth_break"
        limit = self.two_colours.limit if self.two_colours.kind == "depth_break" else 0.0
        best = 0 if self.best == "auto" else self.best
        blended = Blend(rejection_of(self.rejection), power_of(self.weights), best, limit)
        return ColourRules(self.feather, blended, breaks, self.best == "auto")

    def _outputs(self, outputs: list[ColourJobs]) -> Iterator[RasterSpec | Job]:
        """The colours of all outputs, and before them how wide the zone next to limits is."""
        if self.widening.kind == "limits":
            every, width = [WideningJobs(colour, self.widening.rules) for colour in outputs], self.widening.dilation
            for jobs in every:
                yield from jobs.zones()
                if width == "auto":
                    yield from jobs.trials(self._rules())
            yield choice(every, None if width == "auto" else width)
        for colour in outputs:
            yield from colour.colours(self._rules(), self._widening)

    def _proof(self, colour: ColourJobs) -> Iterator[RasterSpec | Job]:
        """A photograph made again from the others, and compared with itself."""
        yield from colour.sight(self._tolerance)
        yield from colour.left_out(self._rules(), self._widening)
        frame = colour.frame.frame
        (name,) = frame.without
        photo, whole = colour.basis.photos[name], Window(0, 0, *frame.shape)
        level = next(k for k in range(photo.levels) if level_shape((photo.height, photo.width), k) == frame.shape)
        reads: dict[str, Reading] = {
            "blended": Raster(output_layer(frame.name, "blended"), whole),
            "nearest": Raster(output_layer(frame.name, "nearest"), whole),
            "pixels": Raster(photo_raster(name, level), whole),
            "radiometry": PROJECTION_RADIOMETRY,
        }
        difference = output_layer(frame.name, "difference")
        yield colour.frame.raster("difference", "uint8", unit="grey levels")
        yield Job(
            "projection",
            f"{frame.name}-compare",
            compare_left_out,
            reads,
            {"result": left_out_table(frame.name), "difference": Raster(difference, whole)},
            {"name": name},
            scratch=120 * frame.rows * frame.cols,
        )

    def _facts(self, colour: ColourJobs) -> OutputFacts:
        jobs, block = colour.frame, colour.basis.block
        centres = [block.of(name).centre for name in colour.basis.names]
        cut = not isinstance(jobs.section, NoSection)
        return OutputFacts(jobs.frame, len(jobs.tiles), colour.pixel, degrees_before(jobs.frame, centres), cut)

    def _results(
        self, coloured: list[ColourJobs], outputs: int, basis: ProjectionBasis, model: ModelJobs | None
    ) -> Iterator[Job | Export]:
        """The report and the products."""
        made, proofs = coloured[:outputs], coloured[outputs:]
        reads: dict[str, Reading] = {
            "census": CENSUS,
            "facing": FACING,
            "radiometry": PROJECTION_RADIOMETRY,
            "statistics": tuple(statistics_table(colour.frame.name, tile) for colour in made for tile in colour.frame.tiles),
            "left_out": tuple(left_out_table(colour.frame.name) for colour in proofs),
            "textures": model.facts() if model else (),
        }
        if self._widening:
            reads["widening"] = self._widening
        facts = tuple(self._facts(colour) for colour in made)
        proven = tuple(colour.frame.name for colour in proofs)
        writes = {"report": report_table("projection")}
        pictured = basis.names[:PICTURED] if self.depth_pictures else ()
        params = {"outputs": facts, "proofs": proven, "pictured": pictured, "whole_model": bool(model and model.is_whole)}
        yield Job("projection", "report", projection_report, reads, writes, params)
        for colour in made:
            frame = colour.frame.frame
            rasters = {"rgba": output_layer(frame.name, "ortho")}
            # Only what lies on a plane has coordinates; a view and an unrolled cylinder are pictures.
            mapped = isinstance(frame, FlatFrame)
            kind = "cog" if mapped else "png"
            yield Export("projection", f"{frame.name}-{kind}", f"products/{frame.name}.{'tif' if mapped else 'png'}", kind, rasters)
        yield Export("projection", "frames_json", "products/projections.json", "json", tables=(FRAMES,))


def left_out_table(name: str) -> Table[LeftOutPhotograph]:
    """The comparison of a photograph that was left out."""
    return Table(f"projection/{name}.json", LeftOutPhotograph)
