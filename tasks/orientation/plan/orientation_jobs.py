"""The jobs of the stage `orientation`: the control, the pairs, the block, its report and its products."""

from collections.abc import Callable, Iterator
from typing import Any

from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.job import Export, HeightFile, Job, Raster, Table, TextFile
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.observations import CONTROL, GROUND_POINTS, IMAGE_RESIDUALS, TIE_POINT_COUNTS, TIE_POINTS, GroundPoints
from orthomill.schemas.orientation import BLOCK, BLOCK_PRECISION, GROUND_RESIDUALS, RELATIVE, SEPARATE_BLOCKS, Block
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import PlaneSurface
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.orientation.examined.overlap_map import OVERLAP, SIDE, overlap_map
from orthomill.tasks.orientation.exterior.adjusted_block import orient_block
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices
from orthomill.tasks.orientation.exterior.fixed_block import orient_fixed
from orthomill.tasks.orientation.exterior.started_block import orient_from
from orthomill.tasks.orientation.orientation_settings import ForeignSource
from orthomill.tasks.orientation.plan.control_jobs import Reads, control_jobs
from orthomill.tasks.orientation.plane.block_on_plane import PLANE, SURVEY_BLOCK, SURVEY_POINTS, block_on_plane
from orthomill.tasks.orientation.relative.pairs import no_pairs, relate_pairs
from orthomill.tasks.orientation.report.block_report import report
from orthomill.tasks.orientation.results.block_tables import BlockTables
from orthomill.tasks.orientation.results.products import PRODUCTS, block_products, product_table
from orthomill.tasks.orientation.stage import OrientationStage

_AT_LEAST = 32 * MIB
"""bytes of working memory of a block of a few photographs"""
_PER_RAY, _PER_RELATED = 1700, 100
"""bytes per image measurement of the adjustment and of the pairs (measured with blocks of 20 thousand to 2 million)"""
Tables = dict[str, Raster | Table]
BLOCK_TABLES: Tables = {
    "block": BLOCK,
    "points": GROUND_POINTS,
    "image_residuals": IMAGE_RESIDUALS,
    "ground_residuals": GROUND_RESIDUALS,
    "precision": BLOCK_PRECISION,
}


def orientation_jobs(asked: OrientationStage, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
    """Control, pairs, the block, and what is made from it."""
    yield from control_jobs(view)
    fixed, grid = asked.fixed_source, view.project.grid
    tables = BLOCK_TABLES if grid.kind == "map" else BLOCK_TABLES | {"block": SURVEY_BLOCK, "points": SURVEY_POINTS}
    block = SURVEY_BLOCK if grid.kind == "plane" else BLOCK
    points = SURVEY_POINTS if grid.kind == "plane" else GROUND_POINTS
    yield from _fixed_jobs(view, fixed, tables) if fixed else _adjusted_jobs(asked, view, tables)
    if grid.kind == "plane":
        yield from _plane_jobs(grid)
    yield RasterSpec(name=OVERLAP, shape=(SIDE, SIDE), dtype="uint8", chunk=SIDE)
    yield from _report_jobs(block, points)
    yield Export("orientation", "cameras", "products/cameras.json", "json", tables=(block,))
    for name, path in PRODUCTS.items():
        yield Export("orientation", name, f"products/{path}", "text", tables=(product_table(name),))


def _report_jobs(block: Table[Block], points: Table[GroundPoints]) -> Iterator[Job]:
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
        scratch=array_bytes(64, SIDE, SIDE),
    )


def _adjusted_jobs(asked: OrientationStage, view: ProjectView, tables: Tables) -> Iterator[Job]:
    rays = view.table(TIE_POINT_COUNTS).rays
    yield Job(
        stage="orientation",
        item="pairs",
        function=relate_pairs,
        reads={"photos": PHOTOS, "cameras": CAMERAS, "tie_points": TIE_POINTS},
        writes={"relative": RELATIVE},
        params={"least": asked.least_matches},
        scratch=_AT_LEAST + array_bytes(_PER_RELATED, rays),
    )
    choices = BlockChoices(
        interior=asked.interior,
        gnss_shift=asked.gnss_shift,
        vertical_sigma=asked.vertical_sigma,
        rejection=asked.rejection,
        lever_arm=asked.lever_arm,
        lever_sigma=asked.lever_sigma,
        looking=asked.looking,
        variation=asked.variation,
    )
    function: Callable[..., BlockTables] = orient_block
    reads: Reads = {"photos": PHOTOS, "cameras": CAMERAS, "tie_points": TIE_POINTS, "control": CONTROL, "relative": RELATIVE}
    params: dict[str, Any] = {"crs": view.project.crs, "choices": choices}
    if asked.exterior.kind != "adjusted":
        function, params = orient_from, params | {"source": asked.exterior}
        reads["texts"] = tuple(TextFile(path) for path in asked.exterior.files)
    if asked.elevation is not None:
        lattice = asked.elevation.lattice(view.table(PHOTOS))
        window, own = Window(0, 0, *lattice.grid.shape), asked.elevation
        reads["heights"] = HeightFile(own.path, view.project.crs, lattice.grid, window, own.system)
        params |= {"lattice": lattice}
    yield Job(
        stage="orientation",
        item="block",
        function=function,
        reads=reads,
        writes=tables | {"separate": SEPARATE_BLOCKS},
        params=params,
        scratch=_AT_LEAST + array_bytes(_PER_RAY, rays),
        remedy="use fewer tie points ('max_matched' of tie_points)",
    )


def _fixed_jobs(view: ProjectView, source: ForeignSource, tables: Tables) -> Iterator[Job]:
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
        scratch=_AT_LEAST + array_bytes(_PER_RAY, rays),
    )


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
