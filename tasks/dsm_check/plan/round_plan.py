"""The rasters and jobs of one pass of the check: two orthoimages for every pair, and the nodes at which they are compared.

A pass works on a grid of its own: that of the surface, or a coarser one on which large errors are small. It covers the whole
surface, or only the tiles in which an earlier pass changed something.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.schemas.epipolar import grey_table
from orthomill.schemas.job import Job, Raster, Region, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos, photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.surface import Surface
from orthomill.tasks.dsm_check.comparison_settings import NodeMatching
from orthomill.tasks.dsm_check.correction_map import CorrectionNodes
from orthomill.tasks.dsm_check.coverage import CHECKED_PAIRS, CheckedPair, CheckedPairs, ground_pixel
from orthomill.tasks.dsm_check.height_correction import Correction
from orthomill.tasks.dsm_check.joint_correction import BENDS, PairGeometry
from orthomill.tasks.dsm_check.nodes import BANDS, NodeTile, check_nodes
from orthomill.tasks.dsm_check.precision.pair_bends import TilePairs, compare_pairs, pair_bends
from orthomill.tasks.dsm_check.rounds.round_state import RoundState
from orthomill.tasks.dsm_check.tile import NodeWindow
from orthomill.tasks.dsm_check.working_orthoimage import WorkingTile, ortho_tile
from orthomill.tasks.geometry.footprint import photo_window
from orthomill.tasks.geometry.photograph_part import level_window, photo_level
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.imagery.pyramid import level_shape

KIND = "dsm_check"
Reads = dict[str, Region | tuple[Region, ...]]


@dataclass(frozen=True)
class Comparing:
    """How orthoimages are compared in a pass."""

    matching: NodeMatching
    correction: Correction
    step: int
    """cells from node to node"""
    reach: float
    """cells: how far the correction of a node reaches"""


@dataclass(frozen=True)
class CheckScene:
    """Photographs and their block."""

    block: Block
    photos: Photos
    crs: str


@dataclass(frozen=True)
class CheckRound:
    """One pass over a surface; its rasters begin with `prefix`."""

    prefix: str
    scene: CheckScene
    surface: Surface
    """grid and height bounds of this pass"""
    pairs: CheckedPairs
    heights: str
    """raster of the surface under test"""
    tile: int
    how: Comparing
    coarse: bool = False
    """whether its cells are so wide that the pyramids of the photographs are read"""
    again: RoundState | None = None
    """tiles that are looked at; None: all"""

    @property
    def grid(self) -> MapGrid:
        return self.surface.grid

    @property
    def item(self) -> str:
        """What the names of its jobs begin with."""
        return self.prefix.removeprefix(KIND).strip("/") + "-" if self.prefix != KIND else ""

    def jobs(self) -> Iterator[RasterSpec | Job]:
        """Orthoimages and nodes of all pairs."""
        for pair in self.pairs.pairs:
            yield from self._orthoimages(pair)
            yield from self._nodes(pair)

    @property
    def nodes(self) -> CorrectionNodes:
        """The grid of nodes, and how far they reach."""
        return correction_nodes(self.how, self.pairs.pixels_per_cell)

    def _wanted(self, pair: CheckedPair, tile: Tile, places: frozenset[tuple[int, int]] | None) -> bool:
        window = shifted(tile.window, pair.window.row, pair.window.col)
        return places is None or (window.row // self.tile, window.col // self.tile) in places

    def _orthoimages(self, pair: CheckedPair) -> Iterator[RasterSpec | Job]:
        factor, window, grid = self.pairs.pixels_per_cell, pair.window, self.grid
        # a raster per pair on the window of the pair: whole-surface rasters for every pair would be mostly empty
        own = MapGrid(
            west=grid.west + window.col * grid.cell,
            north=grid.north - window.row * grid.cell,
            cell=grid.cell / factor,
            rows=window.height * factor,
            cols=window.width * factor,
        )
        places = None if self.again is None else frozenset(self.again.orthoimages)
        for side, photo in (("left", pair.left), ("right", pair.right)):
            name = ortho_raster(pair.name, side, self.prefix)
            yield map_raster(name, own, "uint8", self.scene.crs, self.tile * factor, nodata=0, unit="grey")
            for tile in tiles_of(pair.window.shape, self.tile):
                if self._wanted(pair, tile, places):
                    yield self._orthoimage(pair, side, photo, tile)

    def _orthoimage(self, pair: CheckedPair, side: str, photo: str, tile: Tile) -> Job:
        window, block = shifted(tile.window, pair.window.row, pair.window.col), self.scene.block
        # one cell more: the bilinear heights of the outermost pixels use the neighbouring cells
        heights = window.grown(1).clipped(self.grid.shape)
        seen = photo_window(block_view(block, photo), self.grid, window, self.surface.height_low, self.surface.height_high)
        level = self._level(photo)
        shape = level_shape((block.camera_of(photo).height, block.camera_of(photo).width), level)
        seen = level_window(seen, level, shape) if not seen.empty else seen
        reads: Reads = {"heights": Raster(self.heights, heights)}
        if not seen.empty:
            reads["pixels"] = Raster(photo_raster(photo, level), seen)
            # 16-bit photographs get the stretch that their epipolar images have, so both stages match the same grey values
            if self.scene.photos[photo].dtype != "uint8":
                reads["stretch"] = grey_table(photo)
        factor = self.pairs.pixels_per_cell
        what = WorkingTile(
            orientation=block.of(photo),
            camera=block.camera_of(photo),
            grid=self.grid,
            window=window,
            heights=heights,
            pixels_per_cell=factor,
            photo=seen,
            level=level,
        )
        return Job(
            stage=KIND,
            item=f"{self.item}ortho-{pair.name}-{side}",
            function=ortho_tile,
            reads=reads,
            writes={"ortho": Raster(ortho_raster(pair.name, side, self.prefix), tile.window.scaled(factor))},
            params={"tile": what},
            row=tile.row,
            col=tile.col,
            scratch=array_bytes(24, seen),
        )

    def _level(self, photo: str) -> int:
        """The pyramid level of a photograph that is read."""
        if not self.coarse:
            return 0
        pixel = ground_pixel(self.scene.block, self.surface)
        return photo_level(self.grid.cell / self.pairs.pixels_per_cell, pixel, self.scene.photos[photo].levels)

    def _nodes(self, pair: CheckedPair) -> Iterator[RasterSpec | Job]:
        shape = tuple(-(-side // self.how.step) for side in pair.window.shape)
        yield RasterSpec(
            name=node_raster(pair.name, self.prefix),
            shape=(*shape, len(BANDS)),
            dtype="float32",
            chunk=self.tile // self.how.step,
            nodata=float("nan"),
        )
        places = None if self.again is None else frozenset(self.again.nodes)
        for tile in tiles_of(pair.window.shape, self.tile):
            if self._wanted(pair, tile, places):
                yield self._node_tile(pair, tile)

    def _node_tile(self, pair: CheckedPair, tile: Tile) -> Job:
        factor = self.pairs.pixels_per_cell
        seen = tile.window.grown(node_halo(self.how, factor)).clipped(pair.window.shape)
        what = NodeTile(
            left=self.scene.block.of(pair.left),
            right=self.scene.block.of(pair.right),
            grid=self.grid,
            window=shifted(tile.window, pair.window.row, pair.window.col),
            seen=shifted(seen, pair.window.row, pair.window.col),
            pixels_per_cell=factor,
            step=self.how.step,
        )
        reads: Reads = {
            "left": Raster(ortho_raster(pair.name, "left", self.prefix), seen.scaled(factor)),
            "right": Raster(ortho_raster(pair.name, "right", self.prefix), seen.scaled(factor)),
            "heights": Raster(self.heights, what.seen),
        }
        return Job(
            stage=KIND,
            item=f"{self.item}nodes-{pair.name}",
            function=check_nodes,
            reads=reads,
            writes={"nodes": Raster(node_raster(pair.name, self.prefix), coarser(tile.window, self.how.step))},
            params={"tile": what, "matching": self.how.matching, "correction": self.how.correction},
            row=tile.row,
            col=tile.col,
            scratch=array_bytes(8 + 45 * factor**2, seen),
        )

    def bends(self) -> Iterator[Job]:
        """By how much the pairs bend against each other."""
        tables = []
        for tile in tiles_of(self.grid.shape, self.tile):
            windows, near = self.near(tile.window)
            tables.append(Table(f"dsm_check/apart/{tile.row}-{tile.col}.json", TilePairs))
            params = {"pairs": windows, "grid": self.nodes, "pixel_height": self.pairs.pixel_height}
            yield Job(
                stage=KIND,
                item="pairs-apart",
                function=compare_pairs,
                reads={"nodes": near},
                writes={"apart": tables[-1]},
                params=params,
                row=tile.row,
                col=tile.col,
            )
        yield Job(
            stage=KIND,
            item="bends",
            function=pair_bends,
            reads={"tiles": tuple(tables), "pairs": CHECKED_PAIRS},
            writes={"bends": BENDS},
        )

    def near(self, window: Window) -> tuple[tuple[NodeWindow, ...], tuple[Raster, ...]]:
        """The nodes of all pairs in and around a tile: counted over the whole surface, and as regions of the pairs' rasters."""
        windows, reads = [], []
        for pair in self.pairs.pairs:
            named, read = self._nodes_near(pair, window)
            # a pair that does not reach the tile is left out: an empty window is no region that could be read
            if not named.given.empty:
                windows.append(named)
                reads.append(read)
        return tuple(windows), tuple(reads)

    def _nodes_near(self, pair: CheckedPair, window: Window) -> tuple[NodeWindow, Raster]:
        box, own = coarser(pair.window, self.how.step), coarser(window, self.how.step)
        inside = shifted(own, -box.row, -box.col)
        given = inside.grown(self.nodes.halo).clipped(box.shape)
        own = inside.clipped(box.shape)
        geometry = PairGeometry(pair.left, pair.right, pair.direction)
        named = NodeWindow(pair.name, shifted(given, box.row, box.col), shifted(own, box.row, box.col), geometry)
        return named, Raster(node_raster(pair.name, self.prefix), given)


def correction_nodes(how: Comparing, pixels_per_cell: int) -> CorrectionNodes:
    """The grid of nodes on orthoimages of so many pixels along a cell, and how far they reach."""
    # A corrected point lies off its node by the shift in either orthoimage, in the worst case by twice the reach of the search.
    move = 2 * how.matching.search.reach / pixels_per_cell
    side = (2 * how.matching.least_squares.reach + 1) / pixels_per_cell
    return CorrectionNodes(how.step, pixels_per_cell, how.reach, move, side)


def node_halo(how: Comparing, pixels_per_cell: int) -> int:
    """Cells around a tile that its nodes need: an even number, so that pixels of half size are the same in every tile."""
    return -(-how.matching.halo // (2 * pixels_per_cell)) * 2


def ortho_raster(pair: str, side: str, prefix: str = KIND) -> str:
    """uint8 (rows, cols) grey, 0 without data; one or two pixels along a cell of the pair's window."""
    return f"{prefix}/ortho/{pair}/{side}"


def node_raster(pair: str, prefix: str = KIND) -> str:
    """float32 (rows, cols, bands): see `nodes.BANDS`."""
    return f"{prefix}/nodes/{pair}"


def coarser(window: Window, size: int) -> Window:
    """The blocks of `size` cells of a window that begins at a multiple of `size`."""
    return Window(window.row // size, window.col // size, -(-window.height // size), -(-window.width // size))


def shifted(window: Window, row: int, col: int) -> Window:
    """The window moved by whole cells."""
    return Window(window.row + row, window.col + col, window.height, window.width)
