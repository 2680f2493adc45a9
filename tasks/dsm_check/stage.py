"""The check of the surface without reference data, tile by tile.

First the pairs that check it are selected. Every pair and tile gets two orthoimages made with the surface under test, then the
nodes at which they are compared. A tile of the result needs the nodes around it of every pair that shows it; the report is made of
the coarse blocks and counts of all tiles.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.epipolar import PAIRS, grey_table
from orthomill.schemas.job import Export, Job, MapFile, MapHeader, Raster, Region, Table
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, Photos, photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import CORRECTED, HEIGHT, PROVENANCE, SURFACE, Surface
from orthomill.tasks.dsm_check.areas import block_size
from orthomill.tasks.dsm_check.correction_map import CorrectionNodes
from orthomill.tasks.dsm_check.coverage import (
    CHECKED_PAIRS,
    CHECKED_SURFACE,
    CheckedPair,
    CheckedPairs,
    choose_checked_pairs,
    foreign_surface,
    measured_surface,
)
from orthomill.tasks.dsm_check.height_correction import Correction, RayCorrection
from orthomill.tasks.dsm_check.nodes import BANDS, NodeMatching, NodeTile, check_nodes
from orthomill.tasks.dsm_check.report import DETECTABLE, DH, PRECISION, Blocks, report
from orthomill.tasks.dsm_check.statistics import TileCounts
from orthomill.tasks.dsm_check.tile import CorrectionRule, NodeWindow, correct_tile, take_surface
from orthomill.tasks.dsm_check.working_orthoimage import WorkingTile, ortho_tile
from orthomill.tasks.geometry.footprint import photo_window
from orthomill.tasks.geometry.view import block_view

INPUT = "dsm_check/input"
"""float32 m: the surface under test, whatever its source"""
COARSE = "dsm_check/coarse"
"""float32 (rows, cols, 3): share checked, mean correction and mean sigma (m) in blocks of cells"""


class DensifiedSurface(Settings):
    """The surface that this project measured."""

    kind: Literal["densification"] = "densification"


class SurfaceFile(Settings):
    """A surface model from a file; it is resampled to the grid of the project's own surface if there is one."""

    kind: Literal["file"]
    path: str = setting(..., "GeoTIFF with heights, relative to the project's root.")


Reads = dict[str, Region | tuple[Region, ...]]

CheckedSurface = Annotated[DensifiedSurface | SurfaceFile, Field(discriminator="kind")]


@dataclass(frozen=True)
class _Plan:
    """The tables that planning needs."""

    block: Block
    photos: Photos
    surface: Surface
    pairs: CheckedPairs
    tile: int

    @property
    def grid(self) -> MapGrid:
        return self.surface.grid


class DsmCheckStage(Stage):
    """Two orthoimages made with the surface must agree; where they do not, their shift gives the error of the height."""

    title: ClassVar[str] = "Surface model check"
    usual_cost: ClassVar[float] = 22.0

    kind: Literal["dsm_check"] = "dsm_check"
    surface: CheckedSurface = setting(DensifiedSurface(), "The surface that is checked.")
    pairs: int | None = setting(None, "Pairs that check the surface; null: as many as cover it once.", ge=1)
    pixels_per_cell: int | None = setting(
        None, "Pixels of orthoimage along a cell, 1 or 2; null: 2 where cells are coarser than the photographs.", ge=1, le=2
    )
    step: Literal[2, 4, 8, 16] = setting(4, "Distance of the nodes where the orthoimages are compared.", "cells")
    matching: NodeMatching = setting(NodeMatching(), "How the orthoimages are compared.")
    correction: Correction = setting(RayCorrection(), "How a shift becomes a height.")
    radius: float = setting(1.5, "How far the correction of a node reaches.", "steps", ge=1.25, le=8)
    apply: Literal["all", "significant", "none"] = setting(
        "significant", "Which corrections are added to the surface; below their own standard error they would add noise."
    )
    # Of a million cells three or four standard errors are exceeded by thousands without any error of the surface.
    significance: float = setting(5.0, "A correction of this many of its standard errors is significant.", "sigma", ge=1, le=10)

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        size = view.project.tile
        yield self._surface(view)
        yield Job(
            self.kind,
            "pairs",
            choose_checked_pairs,
            {"pairs": PAIRS, "block": BLOCK, "surface": CHECKED_SURFACE},
            {"checked": CHECKED_PAIRS},
            {"tile": size, "count": self.pairs, "pixels_per_cell": self.pixels_per_cell},
        )
        # The grid of a file is known only after its header was read: planning continues when that job is done.
        surface = view.table(CHECKED_SURFACE)
        yield from self._input(view, surface.grid, size)
        plan = _Plan(view.table(BLOCK), view.table(PHOTOS), surface, view.table(CHECKED_PAIRS), size)
        for pair in plan.pairs.pairs:
            yield from self._orthoimages(view, plan, pair)
            yield from self._nodes(plan, pair)
        yield from self._answer(view, plan)

    def _surface(self, view: ProjectView) -> Job:
        writes: dict[str, Raster | Table] = {"surface": CHECKED_SURFACE}
        if self.surface.kind == "densification":
            return Job(self.kind, "surface", measured_surface, {"surface": SURFACE}, writes)
        reads: Reads = {"grid": MapHeader(self.surface.path, view.project.crs), "block": BLOCK}
        if view.has_stage("densification"):
            reads["surface"] = SURFACE
        return Job(self.kind, "surface", foreign_surface, reads, writes)

    def _input(self, view: ProjectView, grid: MapGrid, size: int) -> Iterator[RasterSpec | Job]:
        """The jobs that fill the raster under test, whatever its source."""
        yield map_raster(INPUT, grid, "float32", view.table(BLOCK).crs, size, nodata=float("nan"), unit="m")
        for tile in tiles_of(grid.shape, size):
            yield Job(
                self.kind,
                "input",
                take_surface,
                {"heights": self._source(view, grid, tile.window)},
                {"input": Raster(INPUT, tile.window)},
                row=tile.row,
                col=tile.col,
            )

    def _source(self, view: ProjectView, grid: MapGrid, window: Window) -> Region:
        if self.surface.kind == "densification":
            return Raster(HEIGHT, window)
        return MapFile(self.surface.path, view.project.crs, grid, window)

    def _orthoimages(self, view: ProjectView, plan: _Plan, pair: CheckedPair) -> Iterator[RasterSpec | Job]:
        factor, window, grid = plan.pairs.pixels_per_cell, pair.window, plan.grid
        # a raster per pair on the window of the pair: whole-surface rasters for every pair would be mostly empty
        own = MapGrid(
            west=grid.west + window.col * grid.cell,
            north=grid.north - window.row * grid.cell,
            cell=grid.cell / factor,
            rows=window.height * factor,
            cols=window.width * factor,
        )
        for side, photo in (("left", pair.left), ("right", pair.right)):
            name = ortho_raster(pair.name, side)
            yield map_raster(name, own, "uint8", view.table(BLOCK).crs, plan.tile * factor, nodata=0, unit="grey")
            for tile in tiles_of(pair.window.shape, plan.tile):
                yield self._orthoimage(plan, pair, side, photo, tile)

    def _orthoimage(self, plan: _Plan, pair: CheckedPair, side: str, photo: str, tile: Tile) -> Job:
        window = _shifted(tile.window, pair.window.row, pair.window.col)
        # one cell more: the bilinear heights of the outermost pixels use the neighbouring cells
        heights = window.grown(1).clipped(plan.grid.shape)
        seen = photo_window(block_view(plan.block, photo), plan.grid, window, plan.surface.height_low, plan.surface.height_high)
        reads: Reads = {"heights": Raster(INPUT, heights)}
        if not seen.empty:
            reads["pixels"] = Raster(photo_raster(photo), seen)
            # 16-bit photographs get the stretch that their epipolar images have, so both stages match the same grey values
            if plan.photos[photo].dtype != "uint8":
                reads["stretch"] = grey_table(photo)
        factor = plan.pairs.pixels_per_cell
        what = WorkingTile(plan.block.of(photo), plan.block.camera_of(photo), plan.grid, window, heights, factor, seen)
        return Job(
            self.kind,
            f"ortho-{pair.name}-{side}",
            ortho_tile,
            reads,
            {"ortho": Raster(ortho_raster(pair.name, side), tile.window.scaled(factor))},
            {"tile": what},
            row=tile.row,
            col=tile.col,
            scratch=seen.height * seen.width * 24,
        )

    def _nodes(self, plan: _Plan, pair: CheckedPair) -> Iterator[RasterSpec | Job]:
        shape = tuple(-(-side // self.step) for side in pair.window.shape)
        yield RasterSpec(
            name=node_raster(pair.name),
            shape=(*shape, len(BANDS)),
            dtype="float32",
            chunk=plan.tile // self.step,
            nodata=float("nan"),
        )
        for tile in tiles_of(pair.window.shape, plan.tile):
            yield self._node_tile(plan, pair, tile)

    def _node_tile(self, plan: _Plan, pair: CheckedPair, tile: Tile) -> Job:
        factor = plan.pairs.pixels_per_cell
        # an even number of cells, so that pixels of half size are the same in every tile
        seen = tile.window.grown(-(-self.matching.halo // (2 * factor)) * 2).clipped(pair.window.shape)
        what = NodeTile(
            plan.block.of(pair.left),
            plan.block.of(pair.right),
            plan.grid,
            _shifted(tile.window, pair.window.row, pair.window.col),
            _shifted(seen, pair.window.row, pair.window.col),
            factor,
            self.step,
        )
        reads: Reads = {
            "left": Raster(ortho_raster(pair.name, "left"), seen.scaled(factor)),
            "right": Raster(ortho_raster(pair.name, "right"), seen.scaled(factor)),
            "heights": Raster(INPUT, what.seen),
        }
        return Job(
            self.kind,
            f"nodes-{pair.name}",
            check_nodes,
            reads,
            {"nodes": Raster(node_raster(pair.name), self._of_nodes(tile.window))},
            {"tile": what, "matching": self.matching, "correction": self.correction},
            row=tile.row,
            col=tile.col,
            scratch=seen.height * seen.width * (8 + 45 * factor**2),
        )

    def _of_nodes(self, window: Window) -> Window:
        return _coarser(window, self.step)

    def _answer(self, view: ProjectView, plan: _Plan) -> Iterator[RasterSpec | Job | Export]:
        for name in (DH, PRECISION, DETECTABLE, CORRECTED):
            yield map_raster(name, plan.grid, "float32", view.table(BLOCK).crs, plan.tile, nodata=float("nan"), unit="m")
        size = block_size(plan.grid.shape)
        shape = tuple(-(-side // size) for side in plan.grid.shape)
        coarse = RasterSpec(name=COARSE, shape=(*shape, 3), dtype="float32", chunk=plan.tile // size)
        yield coarse
        tiles = list(tiles_of(plan.grid.shape, plan.tile))
        for tile in tiles:
            yield self._answer_tile(plan, tile, size)
        yield Job(
            self.kind,
            "report",
            report,
            {"tiles": tuple(_counts_table(t) for t in tiles), "pairs": CHECKED_PAIRS, "coarse": Raster(COARSE, coarse.full)},
            {"report": report_table(self.kind)},
            {"blocks": Blocks(plan.grid, size, self.significance)},
            scratch=16 * coarse.bytes_of(coarse.full),
        )
        bands = {"dh": DH, "height": CORRECTED, "sigma": PRECISION, "detectable": DETECTABLE}
        yield Export(self.kind, "product", "products/dsm_check.tif", "cog", bands)

    def correction_nodes(self, pixels_per_cell: int) -> CorrectionNodes:
        """The grid of nodes on orthoimages of so many pixels along a cell, and how far they reach."""
        # A corrected point lies off its node by the shift in either orthoimage, in the worst case by twice the reach of the search.
        move = 2 * self.matching.search.reach / pixels_per_cell
        side = (2 * self.matching.least_squares.reach + 1) / pixels_per_cell
        return CorrectionNodes(self.step, pixels_per_cell, self.radius * self.step, move, side)

    def _answer_tile(self, plan: _Plan, tile: Tile, size: int) -> Job:
        nodes = self.correction_nodes(plan.pairs.pixels_per_cell)
        reads: list[Region] = []
        windows: list[NodeWindow] = []
        for pair in plan.pairs.pairs:
            window, read = self._nodes_near(plan, pair, tile.window, nodes.halo)
            # a pair that does not reach the tile is left out: an empty window is no region that could be read
            if not window.given.empty:
                windows.append(window)
                reads.append(read)
        rule = CorrectionRule(self.apply, self.significance, nodes, size, plan.pairs.pixel_height)
        return Job(
            self.kind,
            "answer",
            correct_tile,
            {"heights": Raster(INPUT, tile.window), "nodes": tuple(reads), **self._codes(tile.window)},
            _checked_cells(tile, size),
            {"window": tile.window, "pairs": tuple(windows), "rule": rule},
            row=tile.row,
            col=tile.col,
            scratch=tile.window.width * 64 * 96 + tile.window.height * tile.window.width * 64,
        )

    def _codes(self, window: Window) -> Reads:
        """Where the heights under test come from; nothing is known of those of a file."""
        return {"provenance": Raster(PROVENANCE, window)} if self.surface.kind == "densification" else {}

    def _nodes_near(self, plan: _Plan, pair: CheckedPair, window: Window, halo: int) -> tuple[NodeWindow, Raster]:
        """The nodes of a pair in and around a tile: counted over the whole surface, and as a region of the pair's raster."""
        box = self._of_nodes(pair.window)
        own = self._of_nodes(window)
        inside = _shifted(own, -box.row, -box.col)
        given = inside.grown(halo).clipped(box.shape)
        own = inside.clipped(box.shape)
        name = NodeWindow(pair.name, _shifted(given, box.row, box.col), _shifted(own, box.row, box.col))
        return name, Raster(node_raster(pair.name), given)


def ortho_raster(pair: str, side: str) -> str:
    """uint8 (rows, cols) grey, 0 without data; one or two pixels along a cell of the pair's window."""
    return f"dsm_check/ortho/{pair}/{side}"


def node_raster(pair: str) -> str:
    """float32 (rows, cols, bands): see `nodes.BANDS`."""
    return f"dsm_check/nodes/{pair}"


def _checked_cells(tile: Tile, size: int) -> dict[str, Raster | Table]:
    """What a tile writes; size: cells along a coarse block."""
    return {
        "dh": Raster(DH, tile.window),
        "precision": Raster(PRECISION, tile.window),
        "detectable": Raster(DETECTABLE, tile.window),
        "height": Raster(CORRECTED, tile.window),
        "coarse": Raster(COARSE, _coarser(tile.window, size)),
        "counts": _counts_table(tile),
    }


def _counts_table(tile: Tile) -> Table[TileCounts]:
    return Table(f"dsm_check/counts/{tile.row}-{tile.col}.json", TileCounts)


def _coarser(window: Window, size: int) -> Window:
    """The blocks of `size` cells of a window that begins at a multiple of `size`."""
    return Window(window.row // size, window.col // size, -(-window.height // size), -(-window.width // size))


def _shifted(window: Window, row: int, col: int) -> Window:
    return Window(window.row + row, window.col + col, window.height, window.width)
