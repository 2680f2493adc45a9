"""Stage `orientation`: relative orientation pair by pair, then all photographs as one block in the project's system."""

from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.job import Export, HeightFile, Job, Raster, Region, Table, TextFile
from orthomill.schemas.observations import (
    CONTROL,
    GROUND_POINTS,
    IMAGE_RESIDUALS,
    REGISTERED_POINTS,
    TIE_POINT_COUNTS,
    TIE_POINTS,
    Control,
    GroundPoints,
)
from orthomill.schemas.orientation import BLOCK, BLOCK_PRECISION, GROUND_RESIDUALS, RELATIVE, SEPARATE_BLOCKS, Block
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import PlaneSurface
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.settings import refuse_ignored, setting
from orthomill.schemas.stage_contract import Outline, ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.adjustment.model.image_variation import NoVariation, VariationChoice
from orthomill.tasks.adjustment.model.interior import InteriorChoice, WeightedInterior
from orthomill.tasks.geometry.footprint import ground_outline
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.orientation.control.control_files import no_control
from orthomill.tasks.orientation.control.control_system import control_from_files, control_from_list, control_from_scans
from orthomill.tasks.orientation.exterior.adjusted_block import orient_block
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices, ShiftChoice
from orthomill.tasks.orientation.exterior.fixed_block import orient_fixed
from orthomill.tasks.orientation.exterior.sources import Adjusted, ExteriorSource, ForeignSource
from orthomill.tasks.orientation.exterior.started_block import orient_from
from orthomill.tasks.orientation.plane.block_on_plane import PLANE, SURVEY_BLOCK, SURVEY_POINTS, block_on_plane
from orthomill.tasks.orientation.relative.pairs import no_pairs, relate_pairs
from orthomill.tasks.orientation.report import report
from orthomill.tasks.orientation.reporting.overlap_map import OVERLAP, SIDE, overlap_map
from orthomill.tasks.orientation.results.block_tables import BlockTables
from orthomill.tasks.orientation.results.products import PRODUCTS, block_products, product_table
from orthomill.tasks.orientation.sources.elevation_model import ElevationFile
from orthomill.tasks.orientation.start.up_direction import Looking

Reads = dict[str, Region | tuple[Region, ...]]
_AT_LEAST = 32 * 2**20
"""bytes of working memory of a block of a few photographs"""
_PER_RAY, _PER_RELATED = 1700, 100
"""bytes per image measurement of the adjustment and of the pairs (measured with blocks of 20 thousand to 2 million)"""
_SIMULATED = ("photographs/control.csv", "photographs/measurements.csv")
Tables = dict[str, Raster | Table]
BLOCK_TABLES: Tables = {
    "block": BLOCK,
    "points": GROUND_POINTS,
    "image_residuals": IMAGE_RESIDUALS,
    "ground_residuals": GROUND_RESIDUALS,
    "precision": BLOCK_PRECISION,
}
OF_THE_ADJUSTMENT = (
    "least_matches",
    "interior",
    "gnss_shift",
    "lever_arm",
    "lever_sigma",
    "looking",
    "vertical_sigma",
    "rejection",
    "variation",
    "elevation",
)
"""Settings that only the block adjustment reads."""


class OrientationStage(Stage):
    """Relative orientation of pairs, then a bundle adjustment with control, GNSS positions and check points."""

    title: ClassVar[str] = "Relative and block orientation"
    kind: Literal["orientation"] = "orientation"
    exterior: ExteriorSource = setting(
        Adjusted(kind="adjusted"),
        "Where the exterior orientation comes from: the block adjustment, or a file of another program, which is fixed or gives "
        "starting values.",
    )
    least_matches: int = setting(15, "Pairs that share fewer tie points are not related.", "tie points", ge=6)
    interior: InteriorChoice = setting(
        WeightedInterior(kind="weighted"), "How the interior orientation takes part in the adjustment."
    )
    gnss_shift: ShiftChoice = setting(
        "auto",
        "Whether constant errors of the GNSS positions are adjusted: auto: of a flight, or of all positions against control, where "
        "the sources contradict each other without; constant: one of all positions, which needs control; none: never.",
    )
    lever_arm: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0),
        "From the projection centre to the GNSS antenna, in the image system: x right, y up, z backwards, away from the ground.",
        "m",
    )
    lever_sigma: float | None = setting(
        None,
        "Standard error of the lever arm, which is then adjusted, that of each drone (by its serial number) for itself; 0: exactly "
        "known, not adjusted; null: 0.05 m for positions that "
        "are more precise than that in plan, else 0.",
        "m",
        ge=0,
    )
    looking: Looking = setting(
        "auto",
        "How photographs without an attitude look: straight down, or level (held upright, as in a hand); auto takes photographs "
        "that look along the line of their positions or to all sides for level. Used only where positions and control lie on one "
        "line and leave the tilt about it undetermined.",
    )
    vertical_sigma: float | None = setting(
        None,
        "Standard error of the mean vertical by attitudes or `looking`; used only where positions and control lie on one line and "
        "leave the tilt about it undetermined. null: 1 for attitudes of gimbals, 3 of aircraft, else 5.",
        "degrees",
        gt=0,
        le=45,
    )
    rejection: float = setting(
        4.0, "Image measurements with a larger standardised residual are rejected.", "standard errors", ge=2.5
    )

    variation: VariationChoice = setting(
        NoVariation(kind="none"),
        "What of the interior orientation varies from photograph to photograph: nothing, the camera constant (zoom), the principal "
        "point (stabilised), or what a rolling shutter does.",
    )

    elevation: ElevationFile | None = setting(
        None,
        "An elevation model of the ground, a source that the heights and the tilt of the block are compared with; it takes no "
        "part in the adjustment.",
    )

    @model_validator(mode="after")
    def _a_fixed_orientation_is_not_adjusted(self) -> Self:
        if self._fixed_source is not None:
            remedy = "leave it out, or adjust the block with `use: start` or `exterior: {kind: adjusted}`"
            refuse_ignored(self, OF_THE_ADJUSTMENT, "an exterior orientation that is fixed (`use: fixed`)", remedy)
        return self

    @property
    def _fixed_source(self) -> ForeignSource | None:
        """The file that fixes the exterior orientation; None where the block is adjusted."""
        source = self.exterior
        return source if source.kind != "adjusted" and source.use == "fixed" else None

    def remarks(self, view: ProjectView) -> Iterator[str]:
        """What is noticed about the control."""
        control = view.table(CONTROL)
        if control.read:
            yield control.read.sentence
        yield from (finding.sentence for finding in control.findings)

    def outlines(self, view: ProjectView) -> Iterator[tuple[str, Outline]]:
        """Where the corners of every photograph lie at the mean height of the ground."""
        block = view.table(BLOCK)
        for name in block.names:
            if outline := ground_outline(block_view(block, name), block.ground_mean):
                yield name, outline

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        yield self._control(view)
        fixed, grid = self._fixed_source, view.project.grid
        tables = BLOCK_TABLES if grid.kind == "map" else BLOCK_TABLES | {"block": SURVEY_BLOCK, "points": SURVEY_POINTS}
        block = SURVEY_BLOCK if grid.kind == "plane" else BLOCK
        points = SURVEY_POINTS if grid.kind == "plane" else GROUND_POINTS
        yield from self._fixed_jobs(view, fixed, tables) if fixed else self._adjusted_jobs(view, tables)
        if grid.kind == "plane":
            yield from _plane_jobs(grid)
        yield RasterSpec(name=OVERLAP, shape=(SIDE, SIDE), dtype="uint8", chunk=SIDE)
        yield from self._report_jobs(block, points)
        yield Export("orientation", "cameras", "products/cameras.json", "json", tables=(block,))
        for name, path in PRODUCTS.items():
            yield Export("orientation", name, f"products/{path}", "text", tables=(product_table(name),))

    def _report_jobs(self, block: Table[Block], points: Table[GroundPoints]) -> Iterator[Job]:
        """What is made from the block in the project's system, however it was oriented."""
        # Overlap is that on the surface: of photographs of a facade, footprints on level ground say nothing.
        standing: Reads = {} if block is BLOCK else {"on_plane": BLOCK}
        yield Job(
            stage="orientation",
            item="report",
            function=report,
            reads={
                **standing,
                "photos": PHOTOS,
                "cameras": CAMERAS,
                "control": CONTROL,
                "relative": RELATIVE,
                "block": block,
                "points": points,
                "image_residuals": IMAGE_RESIDUALS,
                "ground_residuals": GROUND_RESIDUALS,
                "precision": BLOCK_PRECISION,
            },
            writes={"report": report_table("orientation")},
        )
        yield Job(
            stage="orientation",
            item="products",
            function=block_products,
            reads={"photos": PHOTOS, "block": block, "points": points},
            writes={name: product_table(name) for name in PRODUCTS},
        )
        yield Job(
            stage="orientation",
            item="overlap",
            function=overlap_map,
            reads={"block": BLOCK},
            writes={"map": Raster(OVERLAP, Window(0, 0, SIDE, SIDE))},
            scratch=64 * SIDE * SIDE,
        )

    def _adjusted_jobs(self, view: ProjectView, tables: Tables) -> Iterator[Job]:
        rays = view.table(TIE_POINT_COUNTS).rays
        yield Job(
            stage="orientation",
            item="pairs",
            function=relate_pairs,
            reads={"photos": PHOTOS, "cameras": CAMERAS, "tie_points": TIE_POINTS},
            writes={"relative": RELATIVE},
            params={"least": self.least_matches},
            scratch=_AT_LEAST + _PER_RELATED * rays,
        )
        choices = BlockChoices(
            interior=self.interior,
            gnss_shift=self.gnss_shift,
            vertical_sigma=self.vertical_sigma,
            rejection=self.rejection,
            lever_arm=self.lever_arm,
            lever_sigma=self.lever_sigma,
            looking=self.looking,
            variation=self.variation,
        )
        function: Callable[..., BlockTables] = orient_block
        reads: Reads = {"photos": PHOTOS, "cameras": CAMERAS, "tie_points": TIE_POINTS, "control": CONTROL, "relative": RELATIVE}
        params: dict[str, Any] = {"crs": view.project.crs, "choices": choices}
        if self.exterior.kind != "adjusted":
            function, params = orient_from, params | {"source": self.exterior}
            reads["texts"] = tuple(TextFile(path) for path in self.exterior.files)
        if self.elevation is not None:
            lattice = self.elevation.lattice(view.table(PHOTOS))
            window, own = Window(0, 0, *lattice.grid.shape), self.elevation
            reads["heights"] = HeightFile(own.path, view.project.crs, lattice.grid, window, own.system)
            params |= {"lattice": lattice}
        yield Job(
            stage="orientation",
            item="block",
            function=function,
            reads=reads,
            writes=tables | {"separate": SEPARATE_BLOCKS},
            params=params,
            scratch=_AT_LEAST + _PER_RAY * rays,
            way_out="use fewer tie points ('max_matched' of tie_points)",
        )

    def _fixed_jobs(self, view: ProjectView, source: ForeignSource, tables: Tables) -> Iterator[Job]:
        """The block of another program; tie points examine it, where the workflow has them."""
        yield Job(stage="orientation", item="pairs", function=no_pairs, reads={}, writes={"relative": RELATIVE})
        texts = tuple(TextFile(path) for path in source.files)
        reads: Reads = {"photos": PHOTOS, "cameras": CAMERAS, "control": CONTROL, "texts": texts}
        rays = 0
        # Without tie points the block is taken unexamined, and the report says so.
        if view.has_stage("tie_points"):
            reads["tie_points"], rays = TIE_POINTS, view.table(TIE_POINT_COUNTS).rays
        yield Job(
            stage="orientation",
            item="block",
            function=orient_fixed,
            reads=reads,
            writes=tables,
            params={"crs": view.project.crs, "source": source},
            scratch=_AT_LEAST + _PER_RAY * rays,
        )

    def _control(self, view: ProjectView) -> Job:
        source = view.project.control
        if source.kind == "none":
            return Job(stage="orientation", item="control", function=no_control, reads={}, writes={"control": CONTROL})
        if source.kind == "gcp_list":
            listed: Reads = {"photos": PHOTOS, "text": TextFile(source.path)}
            return _control_job(control_from_list, listed, {"source": source, "crs": view.project.crs})
        if source.kind == "scans":
            scanned: Reads = {"photos": PHOTOS, "registered": REGISTERED_POINTS, "measurements": TextFile(source.measurements)}
            return _control_job(control_from_scans, scanned, {"source": source, "crs": view.project.crs})
        if source.kind == "simulated":
            points, measurements = map(view.run_file, _SIMULATED)
            return _control_job(control_from_files, _control_texts(points, measurements), {"own": None, "crs": view.project.crs})
        reads: Reads = {"photos": PHOTOS, "points": TextFile(source.points)}
        stated: dict[str, Any] = {"own": source.crs, "crs": view.project.crs, "absent": source.absent, "source": source}
        if source.measurements:
            reads["measurements"] = TextFile(source.measurements)
        else:
            stated["measurements"] = None
        # Optional in the project, and then a parameter of the function with a default.
        if source.distances:
            reads["distances"] = TextFile(source.distances)
        return _control_job(control_from_files, reads, stated)


def _plane_jobs(grid: PlaneSurface) -> Iterator[Job | Export]:
    """The block in the system of a plane, for the stages after this one."""
    yield Job(
        stage="orientation",
        item="plane",
        function=block_on_plane,
        reads={"block": SURVEY_BLOCK, "points": SURVEY_POINTS},
        writes={"block": BLOCK, "points": GROUND_POINTS, "plane": PLANE},
        params={"ground": grid},
    )
    yield Export("orientation", "plane_json", "products/plane.json", "json", tables=(PLANE,))


def _control_texts(points: str, measurements: str) -> Reads:
    return {"photos": PHOTOS, "points": TextFile(points), "measurements": TextFile(measurements)}


def _control_job(function: Callable[..., Control], reads: Reads, params: dict[str, Any]) -> Job:
    return Job(stage="orientation", item="control", function=function, reads=reads, writes={"control": CONTROL}, params=params)
