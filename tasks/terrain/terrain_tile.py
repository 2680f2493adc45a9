"""The jobs of one tile: blocks, ground, hidden ground, bridges, cells and points."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.bare_ground import CellClass, PointClasses, TerrainCode
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED, Provenance, Surface, SurfacePoints
from orthomill.tasks.terrain.ground.block_heights import block_heights
from orthomill.tasks.terrain.ground.bridges import BareBlocks, bridge
from orthomill.tasks.terrain.ground.continued_ground import STEPS, continued
from orthomill.tasks.terrain.ground.evened_ground import evened
from orthomill.tasks.terrain.ground.hidden_ground import ToldGround, told_by_ground
from orthomill.tasks.terrain.ground.islands import standing_islands
from orthomill.tasks.terrain.ground.learned_errors import FillErrors
from orthomill.tasks.terrain.ground.mean_value_fill import LONGEST_SLOPE
from orthomill.tasks.terrain.ground.morphological_filter import disc_radii, filter_halo, ground_cells, rings
from orthomill.tasks.terrain.ground.terrain_cells import cell_ground
from orthomill.tasks.terrain.objects.object_classes import RoofRules, cell_classes, point_classes, roof_cells, terrain_codes

MIXED_WIDTH = 6
"""cells beside an object over which windows of the matching see both"""
SURE = 3.0
"""standard errors that the step between two neighbours of ground must have to tell ground from objects"""
_CROWN = 4.0
"""m: no wider is what photographs agree on in the crown of a tree"""
_LEAST_ROOF = 1.5
"""m: half the width of the least roof"""
_WIDEST_CORE = 96
"""cells along it at most: on a grid of millimetres a smaller patch tells a roof, or the surroundings of a tile fill the memory"""
_ROOF_RIM = 8
"""cells around the core of a roof at which the photographs see neither roof nor ground"""


@dataclass(frozen=True)
class TerrainRules:
    """How ground is found: cell of the surface and cells along a block (m, count), the settings of the stage in m and as ratios,
    the shorter side of the map (m)."""

    cell: float
    factor: int
    widest: float
    slope: float
    steepest: float
    roughness: float
    reach: float
    extent: float

    @property
    def block(self) -> float:
        """Side of a block, m."""
        return self.cell * self.factor

    @property
    def radii(self) -> tuple[int, ...]:
        """Of the discs of the filter, blocks."""
        return disc_radii(self.widest / self.block)

    @property
    def filter_halo(self) -> int:
        """Blocks around a tile that decide which of its blocks the filter keeps."""
        return filter_halo(self.radii)

    @property
    def ground_halo(self) -> int:
        """Blocks around a tile of what the filter keeps that decide about its ground."""
        return STEPS + self.margin + 2 * self.across + self.across // 2

    @property
    def across(self) -> int:
        """Blocks along the widest object."""
        return int(np.ceil(self.widest / self.block))

    @property
    def crown(self) -> int:
        """Blocks along the widest patch that may be the crown of a tree."""
        return max(round(_CROWN / self.block), 2)

    @property
    def margin(self) -> int:
        """Blocks beside objects whose ground is not taken as it is."""
        return max(round(MIXED_WIDTH / self.factor), 1)

    @property
    def step(self) -> float:
        """How much higher ground can be than ground in the next block, m."""
        return self.steepest * float(np.sqrt(2.0)) * self.block + self.roughness

    @property
    def far(self) -> int:
        """How far ground is bridged, blocks."""
        return max(round(self.reach / self.block), 1)

    @property
    def fill_halo(self) -> int:
        """Blocks around a tile that its bridges follow from."""
        return self.far + 2 * LONGEST_SLOPE

    @property
    def shift(self) -> int:
        """By how much the pattern of gaps is moved to hide ground, blocks: beyond the objects, but not beyond the map."""
        return max(round(min(1.5 * self.widest, self.extent / 4.0) / self.block), 1)

    @property
    def rise(self) -> float:
        """How much ground may be off the mean of its block, m."""
        return self.roughness + self.steepest * self.block if self.factor > 1 else np.inf

    @property
    def roofs(self) -> RoofRules:
        """In cells of the surface."""
        return RoofRules(min(max(round(_LEAST_ROOF / self.cell), 1), _WIDEST_CORE), _ROOF_RIM)


class TerrainTile(NamedTuple):
    """Rasters of a tile (rows, cols), as in `schemas.bare_ground`."""

    height: np.ndarray
    precision: np.ndarray
    relative: np.ndarray
    code: np.ndarray
    above: np.ndarray
    cell_class: np.ndarray


def evidence(heights: np.ndarray, sigma: np.ndarray, provenance: np.ndarray, rules: TerrainRules) -> np.ndarray:
    """(rows, cols) bool: measured heights (m) so sure that they tell ground from what stands on it."""
    return np.isin(provenance, MEASURED) & np.isfinite(heights) & (sigma <= rules.step / SURE)


def blocks_of_tile(
    heights: np.ndarray, sigma: np.ndarray, datum: np.ndarray, provenance: np.ndarray, rules: TerrainRules
) -> np.ndarray:
    """`block_heights` of the cells of a tile that are evidence."""
    rise = rules.roughness + rules.steepest * rules.block
    return block_heights(heights, sigma, datum, evidence(heights, sigma, provenance, rules), rules.factor, rise)


def filter_tile(blocks: np.ndarray, window: Window, core: Window, rules: TerrainRules) -> np.ndarray:
    """(rows, cols) uint8: 1 for the blocks `core` that the filter keeps; `blocks` (rows, cols, 3) cover `window`."""
    heights = np.ascontiguousarray(blocks[..., 0])
    kept = ground_cells(heights, rules.radii, rules.slope, rules.roughness, rules.block)
    return kept[core.within(window).slices].astype(np.uint8)


def ground_of_tile(blocks: np.ndarray, kept: np.ndarray, window: Window, core: Window, rules: TerrainRules) -> np.ndarray:
    """uint8 `rings` of the blocks `core`, from what the filter kept; both cover `window`."""
    heights = np.ascontiguousarray(blocks[..., 0])
    ground = kept > 0
    rises = rules.step, rules.slope * rules.block, rules.roughness
    ground &= ~standing_islands(ground, heights, rules.across, rises, rules.crown)
    ground = continued(ground, heights, rules.steepest, rules.roughness, rules.block)
    return rings(ground, rules.margin)[core.within(window).slices]


def tell_of_tile(
    blocks: np.ndarray, ground: np.ndarray, window: Window, core: Window, rules: TerrainRules, moved: np.ndarray | None = None
) -> ToldGround:
    """What the ground of the blocks `core` tells; blocks and rings cover `window`, `moved` the same one some blocks away, whose
    part outside the raster is missing: there nothing is hidden."""
    pattern, free = np.full(ground.shape, True), rules.margin + 1
    if moved is not None:
        pattern[: moved.shape[0], : moved.shape[1]] = moved == free
    place = window.row, window.col
    return told_by_ground(blocks, ground, free, pattern, core.within(window).slices, place, rules.far)


def bridge_tile(
    blocks: np.ndarray,
    ground: np.ndarray,
    expected: np.ndarray,
    errors: FillErrors,
    window: Window,
    core: Window,
    rules: TerrainRules,
) -> BareBlocks:
    """The bare ground of the blocks `core`; blocks, rings and expected heights cover `window`."""
    return bridge(blocks, ground, expected, errors, core.within(window).slices, rules.far)


def terrain_tile(
    heights: np.ndarray,
    sigma: np.ndarray,
    provenance: np.ndarray,
    bare: np.ndarray,
    open_side: np.ndarray,
    ground: np.ndarray,
    windows: tuple[Window, Window],
    core: Window,
    rules: TerrainRules,
    surface: Surface,
) -> TerrainTile:
    """The terrain of the cells `core` where the surface is wanted; heights, sigma, provenance cover the first of the windows, the
    rasters of blocks the second, `evened_ground.REACH` blocks larger than what the cells lie between."""
    measured = np.isin(provenance, MEASURED) & np.isfinite(heights)
    sure = evidence(heights, sigma, provenance, rules)
    place = (*windows, rules.factor)
    # Its height and its standard error have the grain of the invention alike.
    bare = np.concatenate([np.stack([evened(bare[..., k], ground > 0) for k in (0, 1)], axis=-1), bare[..., 2:]], axis=-1)
    found = cell_ground(bare, open_side, ground > 0, heights, sigma, sure, place, rules.rise)
    above = heights - found.height
    roof = roof_cells(above, sigma, measured, rules.cell, rules.roofs)
    codes = terrain_codes(np.isfinite(found.height), found.measured, found.bridged, np.nan_to_num(above), roof)
    precision = np.hypot(found.sigma, found.datum)
    whole = TerrainTile(found.height, precision, found.sigma, codes, above.astype(np.float32), cell_classes(codes, above, measured))
    whole = _with_water(whole, heights, sigma, found.datum, provenance == Provenance.WATER)
    inner = core.within(windows[0]).slices
    wanted = surface.wanted.cells(surface.grid, core)
    own = TerrainTile(*(values[inner] for values in whole))
    # The code of nothing is 0, and an empty height no number.
    return TerrainTile(*(np.where(wanted, v, v.dtype.type(np.nan if v.dtype.kind == "f" else 0)) for v in own))


def _with_water(terrain: TerrainTile, level: np.ndarray, sigma: np.ndarray, datum: np.ndarray, water: np.ndarray) -> TerrainTile:
    """The terrain with outlined `water` (rows, cols) bool as the surface has it: level and sigma among neighbours, datum m."""
    here = TerrainTile(
        height=level,
        # far from all ground nothing tells the datum of blocks
        precision=np.hypot(sigma, np.nan_to_num(datum)),
        relative=sigma,
        code=np.full(water.shape, TerrainCode.WATER, np.uint8),
        above=np.zeros(water.shape, np.float32),
        cell_class=np.full(water.shape, CellClass.WATER, np.uint8),
    )
    return TerrainTile(*(np.where(water, new, old).astype(old.dtype) for new, old in zip(here, terrain, strict=True)))


def classify_points(
    points: SurfacePoints, height: np.ndarray, precision: np.ndarray, cell_class: np.ndarray, grid: MapGrid, window: Window
) -> PointClasses:
    """The class of every point of the tile `window`."""
    col, row = grid.pixel(points.x, points.y)
    at = (
        np.clip(np.rint(row).astype(np.int64) - window.row, 0, window.height - 1),
        np.clip(np.rint(col).astype(np.int64) - window.col, 0, window.width - 1),
    )
    return PointClasses(point_classes(points.z, height[at], precision[at], cell_class[at]))
