"""What the passes of a check share: coarse levels, the full resolution, and again where something was corrected.

Every pass leaves a raster of heights for the next one. A pass over the whole surface uses the tiles of the project; a later one,
which looks at a few places, small ones.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.surface import PROVENANCE, Surface
from orthomill.tasks.dsm_check.areas import block_size
from orthomill.tasks.dsm_check.coverage import CheckedPairs
from orthomill.tasks.dsm_check.plan.round_plan import KIND, CheckRound, CheckScene, Comparing, Reads, correction_nodes
from orthomill.tasks.dsm_check.statistics import TileCounts
from orthomill.tasks.dsm_check.surfaces.surface_shift import TREND
from orthomill.tasks.dsm_check.tile import CorrectionRule

NAN = float("nan")
_FEWEST_CELLS = 48
"""along the shorter side of the coarsest level: fewer hold no windows to be compared"""
_SMALL = (256, 128, 64)
"""sides of the tiles of a later pass, cells; the first that divides the tiles of the project"""

Plan = Iterator[RasterSpec | Job]

FILLED = "dsm_check/filled"
"""uint8, 1 where the photographs filled a hole of a surface from a file"""
SECOND, FAR = "dsm_check/second_surface", "dsm_check/far"
"""float32 m: the second surface; uint8, 1 where the given one is far from it"""


@dataclass(frozen=True)
class Passes:
    """What all passes share."""

    scene: CheckScene
    surface: Surface
    pairs: CheckedPairs
    tile: int
    how: Comparing
    closer: Comparing
    """how later passes compare"""
    apply: Literal["all", "significant", "none"]
    significance: float
    count: int | None
    per_place: int
    everywhere: bool
    """whether later passes judge every cell again"""
    measured: bool
    """whether the project measured the surface, and knows where its heights come from"""

    def rule(self) -> CorrectionRule:
        """How corrections at full resolution become a surface."""
        grid, main = self.surface.grid, self.main("")
        return CorrectionRule(self.apply, self.significance, main.nodes, block_size(grid.shape), self.pairs.pixel_height, grid.cell)

    def main(self, heights: str) -> CheckRound:
        """The pass at full resolution."""
        return CheckRound(
            prefix=KIND, scene=self.scene, surface=self.surface, pairs=self.pairs, heights=heights, tile=self.tile, how=self.how
        )

    def tiles(self) -> Iterator[Tile]:
        """The tiles of the surface's grid."""
        return tiles_of(self.surface.grid.shape, self.tile)

    def codes(self, window: Window) -> Reads:
        """Where the heights under test come from; nothing is known of those of a file."""
        return {"provenance": Raster(PROVENANCE, window)} if self.measured else {}

    def raster(self, name: str, dtype: str = "float32") -> RasterSpec:
        """A raster on the grid of the surface."""
        nodata = NAN if dtype == "float32" else 0
        return map_raster(name, self.surface.grid, dtype, self.scene.crs, self.tile, nodata=nodata, unit="m" if nodata else "")

    def lowest(self, levels: int, fewest: int = _FEWEST_CELLS) -> int:
        """How often the orthoimages can be halved: `levels` times at most, and to `fewest` cells along the shorter side."""
        side, level = min(self.surface.grid.shape), 0
        while level < levels and side >> (level + 1) >= fewest:
            level += 1
        return level

    def pairs_of(self, level: int) -> Table[CheckedPairs]:
        """The table of the pairs that check a level."""
        return Table(f"dsm_check/pairs/{level}.json", CheckedPairs)

    @property
    def of_trend(self) -> Reads:
        """The trend of a surface from a file."""
        return {} if self.measured else {"trend": TREND}

    @property
    def around(self) -> int:
        """Cells around a change that have a node with a window on it."""
        nodes = correction_nodes(self.comparing(), self.pairs.pixels_per_cell)
        return int(nodes.window / 2 + nodes.radius) + 2

    def comparing(self) -> Comparing:
        """How later passes compare."""
        return self.how if self.everywhere else self.closer

    def small(self) -> int:
        """The side of the tiles of a later pass, cells."""
        return next(side for side in _SMALL if self.tile % side == 0)

    def blocks(self) -> tuple[int, tuple[int, int]]:
        """Side of a block in cells, and (rows, cols) of blocks."""
        size = block_size(self.surface.grid.shape)
        rows, cols = self.surface.grid.shape
        return size, (-(-rows // size), -(-cols // size))


def of_round(number: int, name: str) -> str:
    """A raster after pass `number` at full resolution."""
    return f"dsm_check/rounds/{number}/{name}"


def counts_table(tile: Tile, name: str = "judged") -> Table[TileCounts]:
    """Counts of a tile after the first pass, or of the answer."""
    return Table(f"dsm_check/{name}/{tile.row}-{tile.col}.json", TileCounts)


def tile_job(
    item: str, function: Callable[..., Any], reads: Reads, writes: Mapping[str, Raster | Table], params: dict[str, Any], tile: Tile
) -> Job:
    """A job of a check on a tile, with memory for a row of windows of 96 values and eight arrays of the tile."""
    return Job(
        stage=KIND,
        item=item,
        function=function,
        reads=reads,
        writes=writes,
        params=params,
        row=tile.row,
        col=tile.col,
        scratch=array_bytes(64, 96, tile.window.width) + array_bytes(64, tile.window),
    )
