"""The rasters of the answer, what a tile of it writes, the report, and the products."""

from collections.abc import Iterator
from typing import Any

from orthomill.schemas.job import Export, Job, Raster, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import RasterSpec, Tile, Window, map_raster
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import CHECKED_CODE, CORRECTED, CheckCode
from orthomill.tasks.dsm_check.area_map import AREA_MAP
from orthomill.tasks.dsm_check.areas import block_size
from orthomill.tasks.dsm_check.coverage import CHECKED_PAIRS
from orthomill.tasks.dsm_check.difference_words import CHANGES, ERRORS
from orthomill.tasks.dsm_check.joint_correction import BENDS
from orthomill.tasks.dsm_check.plan.passes import Passes, counts_table
from orthomill.tasks.dsm_check.plan.round_plan import Reads, coarser
from orthomill.tasks.dsm_check.report.check_report import DETECTABLE, DH, PRECISION, TEST, Blocks, report
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.dsm_check.surfaces.checked_surface import SurfaceFile

COARSE = "dsm_check/coarse"
"""float32 (rows, cols, 5): `areas.blocks` and `areas.slopes` in blocks of cells"""


def answer_writes(tile: Tile, size: int) -> dict[str, Raster | Table]:
    """What a tile of the answer writes; size: cells along a coarse block."""
    names = {"dh": DH, "precision": PRECISION, "test": TEST, "detectable": DETECTABLE, "height": CORRECTED, "code": CHECKED_CODE}
    return {
        **{name: Raster(raster, tile.window) for name, raster in names.items()},
        "coarse": Raster(COARSE, coarser(tile.window, size)),
        "counts": counts_table(tile, "counts"),
    }


def answer_rasters(asked: DsmCheckStage, passes: Passes) -> Iterator[RasterSpec]:
    """What the tiles of the answer write: differences and standard errors in m, tests in sigma, codes, coarse blocks."""
    for name in (DH, PRECISION, TEST, DETECTABLE, CORRECTED):
        yield passes.raster(name) if name != TEST else passes.raster(name).model_copy(update={"unit": "sigma"})
    grid, size = passes.surface.grid, block_size(passes.surface.grid.shape)
    yield map_raster(CHECKED_CODE, grid, "uint8", passes.scene.crs, passes.tile, nodata=CheckCode.EMPTY)
    shape = tuple(-(-side // size) for side in grid.shape)
    yield RasterSpec(name=COARSE, shape=(*shape, 5), dtype="float32", chunk=passes.tile // size)


def report_job(asked: DsmCheckStage, passes: Passes, reads: Reads, params: dict[str, Any]) -> Job:
    """The last job, which puts the tiles together; `reads` and `params`: what only a surface from a file has besides."""
    grid, size = passes.surface.grid, block_size(passes.surface.grid.shape)
    shape = tuple(-(-side // size) for side in grid.shape)
    # A window around every node that the plane of a cell is fitted to: narrower errors lie in a part of that only.
    nodes = passes.main("").nodes
    wide = (nodes.window + 2 * nodes.radius) * grid.cell
    earlier = isinstance(asked.surface, SurfaceFile) and asked.surface.epoch == "earlier"
    words = CHANGES if earlier else ERRORS
    what = Blocks(
        grid=grid,
        size=size,
        significance=asked.significance,
        crs=passes.scene.crs,
        tolerance=asked.tolerance,
        wide=wide,
        words=words,
    )
    tiles = tuple(counts_table(tile, "counts") for tile in passes.tiles())
    coarse = Raster(COARSE, Window(0, 0, *shape))
    writes: dict[str, Raster | Table] = {"report": report_table(asked.kind), "areas": AREA_MAP}
    return Job(
        stage=asked.kind,
        item="report",
        function=report,
        reads={"tiles": tiles, "pairs": CHECKED_PAIRS, "coarse": coarse, "bends": BENDS, **reads},
        writes=writes,
        params={"blocks": what, **params},
        scratch=array_bytes(400, shape),
    )


def exports(asked: DsmCheckStage) -> Iterator[Export]:
    """The answer as one file of bands, the corrected surface where it came from a file, and the areas."""
    bands = {"dh": DH, "height": CORRECTED, "sigma": PRECISION, "detectable": DETECTABLE, "test": TEST, "code": CHECKED_CODE}
    yield Export(asked.kind, "product", "products/dsm_check.tif", "cog", bands)
    if isinstance(asked.surface, SurfaceFile):
        yield Export(asked.kind, "corrected", "products/dsm_corrected.tif", "cog", {"height": CORRECTED})
    yield Export(asked.kind, "areas", "products/dsm_check_areas.geojson", "json", tables=(AREA_MAP,))
