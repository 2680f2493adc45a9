"""The ground of an orthoimage with sharp edges: near walls every pixel lies on the surface that the photographs show there.

What hides is still the surface model: beside a roof it is blurred by a cell or two, which matters little for what is seen, while a
pixel of roof painted at the height of the ground takes its colour from a place metres away.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.colouring.edges.agreement import disagreement, with_agreement
from orthomill.tasks.colouring.edges.likeness import REACH as COLOUR_REACH
from orthomill.tasks.colouring.edges.likeness import Examples, Likeness, Side, likeness, spacing_of, supported
from orthomill.tasks.colouring.edges.wall_surfaces import REACH as HEIGHT_REACH
from orthomill.tasks.colouring.edges.wall_surfaces import WallSurfaces, at_pixels, wall_surfaces
from orthomill.tasks.colouring.sampling.balanced_photograph import BalancedPhotograph, bands_of
from orthomill.tasks.colouring.sampling.ground_sampling import Ground, Sampled, every
from orthomill.tasks.visibility.height_model import HeightModel, Targets, visible_targets

SUPPORT = 1
"""cells around a pixel that support its choice"""
AROUND = COLOUR_REACH + SUPPORT
"""cells around the sharpened pixels whose colours take part"""
HALO = AROUND + HEIGHT_REACH + 1
"""cells around the sharpened pixels whose heights take part"""
_SAME = 12.0  # grey levels: by so much, as a standard deviation, colours of one place of a roof differ among photographs
_STRIP = 32  # rows of pixels whose colours are held for all photographs


@dataclass(frozen=True)
class _Walls:
    """Pixels of `window` (in the ortho grid): heights of both surfaces, m, and `slopes` (rows, cols, 2) of the upper one, m per
    cell; which of them the model has there (`side`, codes of Side); `examples` (they belong to it) and `doubtful`, bool."""

    grid: MapGrid
    window: Window
    upper: np.ndarray
    lower: np.ndarray
    slopes: np.ndarray
    side: np.ndarray
    examples: np.ndarray
    doubtful: np.ndarray

    def ground(self, z: np.ndarray, rows: slice) -> Ground:
        """Level pixels at heights z (rows, cols) m."""
        flat = np.zeros(z[rows].shape, np.float32)
        height = rows.stop - rows.start
        window = Window(self.window.row + rows.start, self.window.col, height, self.window.width)
        return Ground(self.grid, window, np.ascontiguousarray(z[rows]), flat, flat)

    @cached_property
    def strips(self) -> tuple[slice, ...]:
        """The rows, some at a time."""
        return tuple(slice(top, min(top + _STRIP, self.window.height)) for top in range(0, self.window.height, _STRIP))


@dataclass(frozen=True)
class PartedPixels:
    """Pixels near walls (rows, cols): heights of the `upper` and the `lower` surface, m, NaN where there are no two; `slopes`
    (rows, cols, 2) of the upper one to the right and downwards, m per cell; `raised` bool: whether the upper one is there."""

    upper: np.ndarray
    lower: np.ndarray
    slopes: np.ndarray
    raised: np.ndarray


@dataclass(frozen=True)
class SharpenedGround:
    """A ground on which pixels near walls lie on the surface that the photographs show there.

    `doubtful` bool (rows, cols): these pixels; `alike` bool (photos, rows, cols): whose colour there is that of this surface;
    `parted`: both surfaces, None where there is no wall.
    """

    ground: Ground
    doubtful: np.ndarray
    alike: np.ndarray
    parted: PartedPixels | None = None

    @cached_property
    def chosen(self) -> np.ndarray:
        """(rows, cols) bool: the doubtful ones whose surface some photograph shows."""
        return self.doubtful & self.alike.any(axis=0)

    @cached_property
    def told(self) -> np.ndarray:
        """Places of the chosen ones, in the pixels as one row."""
        return np.flatnonzero(self.chosen)


def sharpened(ground: Ground, heights: np.ndarray, certain: HeightModel, photos: list[BalancedPhotograph]) -> SharpenedGround:
    """The ground sharpened at walls.

    heights (rows, cols) m and the measured ones of them, `certain`, in one window, which is HALO cells larger than the ground or
    ends with the model; the parts of the photographs show AROUND cells around the ground.
    """
    window, dsm = ground.window, certain.grid
    divisor = round(dsm.cell / ground.grid.cell)
    wide = window.grown(AROUND * divisor).clipped((dsm.rows * divisor, dsm.cols * divisor))
    near = wide.reduced(divisor).grown(HEIGHT_REACH + 1).clipped(dsm.shape)
    inner = near.within(certain.window).slices
    surfaces = wall_surfaces(heights[inner], np.isfinite(certain.heights[inner]), dsm.cell)
    if not photos or not surfaces.doubtful.any():
        return SharpenedGround(ground, np.zeros(window.shape, bool), np.zeros((len(photos), *window.shape), bool))
    walls = _walls(surfaces, heights[inner], near, wide, ground.grid, divisor)
    place = window.within(wide).slices
    found = _likeness(walls, certain, photos, divisor)
    score, doubtful = found.score[place], walls.doubtful[place]
    # Where the photographs cannot tell, the surface model keeps its word.
    raised = np.where(np.isnan(score), walls.side[place] == Side.UPPER, score < 0)
    z = np.where(doubtful, np.where(raised, walls.upper[place], walls.lower[place]), ground.z)
    lower, upper = found.alike[(slice(None), slice(None), *place)]
    there = np.where(doubtful, raised, walls.side[place] == Side.UPPER)
    parted = PartedPixels(walls.upper[place], walls.lower[place], walls.slopes[place], there)
    return SharpenedGround(replace(ground, z=z.astype(np.float32)), doubtful, np.where(raised, upper, lower), parted)


def _walls(surfaces: WallSurfaces, heights: np.ndarray, near: Window, wide: Window, grid: MapGrid, divisor: int) -> _Walls:
    """The pixels `wide` from the surfaces and heights at the cells `near`."""
    part = wide.within(near.scaled(divisor)).slices
    above, below = surfaces.upper[..., 0], surfaces.lower[..., 0]
    side = np.where(np.abs(heights - above) < np.abs(heights - below), Side.UPPER, Side.LOWER)
    side = np.where(np.isfinite(above) & np.isfinite(heights), side, Side.NEITHER).astype(np.uint8)
    side, smooth, doubtful = (_repeated(cells, divisor)[part] for cells in (side, surfaces.smooth, surfaces.doubtful))
    examples = smooth & (side != Side.NEITHER)
    upper, lower = (np.ascontiguousarray(at_pixels(planes, divisor)[part]) for planes in (surfaces.upper, surfaces.lower))
    slopes = _repeated(surfaces.upper[..., 1:], divisor)[part]
    sides = {"side": side, "examples": examples, "doubtful": doubtful}
    return _Walls(grid=grid, window=wide, upper=upper, lower=lower, slopes=slopes, **sides)


def _repeated(cells: np.ndarray, divisor: int) -> np.ndarray:
    """Values of cells (rows, cols) at the pixels into which they are divided."""
    return np.repeat(np.repeat(cells, divisor, 1), divisor, 0)


def _likeness(walls: _Walls, certain: HeightModel, photos: list[BalancedPhotograph], divisor: int) -> Likeness:
    """The likeness of the doubtful pixels, supported by those around."""
    examples = _examples(walls, certain, photos, divisor)
    shape = walls.doubtful.shape
    whole = Likeness(np.full(shape, np.nan, np.float32), np.zeros((2, len(photos), *shape), bool))
    guides = [np.zeros((*shape, bands_of(photos)), np.float32) for _ in range(2)]
    for rows in walls.strips:
        chosen = walls.doubtful[rows]
        if not chosen.any():
            continue
        grounds = [walls.ground(z, rows) for z in (walls.upper, walls.lower)]
        (upper, lower), shown = _both(grounds, chosen, photos)
        found = likeness(upper, lower, shown, examples, chosen, grounds[0].window, divisor)
        whole.score[rows] = with_agreement(found.score, disagreement(upper, shown, chosen))
        whole.alike[:, :, rows] = found.alike
        for guide, values in zip(guides, (upper, lower), strict=True):
            _mean_shown(values, shown, guide[rows])
    return whole._replace(score=supported(whole.score, guides[0], guides[1], SUPPORT * divisor))


def _both(
    grounds: list[Ground], chosen: np.ndarray, photos: list[BalancedPhotograph]
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Colours (photos, rows, cols, bands) at both heights, and where both are shown (photos, rows, cols) bool."""
    factor = chosen.astype(np.float32)
    shape = len(photos), *chosen.shape
    upper, lower = (np.zeros((*shape, bands_of(photos)), np.float32) for _ in range(2))
    shown = np.zeros(shape, bool)
    for k, photo in enumerate(photos):
        above, below = (np.zeros((2, *chosen.shape), np.float32) for _ in range(2))
        photo.fill(Sampled(upper[k], *above), grounds[0], factor, 0.0)
        photo.fill(Sampled(lower[k], *below), grounds[1], factor, 0.0)
        shown[k] = (above[0] > 0) & (below[0] > 0)
    return (upper, lower), shown


@njit()
def _mean_shown(colours, shown, out):
    """Fills `out` (rows, cols, bands), zeros, with the means of the colours (photos, rows, cols, bands) of photos that show the
    pixel."""
    photos, rows, cols, bands = colours.shape
    for r in range(rows):
        for c in range(cols):
            count = 0
            for p in range(photos):
                if shown[p, r, c]:
                    count += 1
                    for band in range(bands):
                        out[r, c, band] += colours[p, r, c, band]
            for band in range(bands):
                out[r, c, band] /= max(count, 1)


def _examples(walls: _Walls, certain: HeightModel, photos: list[BalancedPhotograph], divisor: int) -> Examples:
    """The colours of pixels that belong to one of the surfaces near doubtful ones."""
    side = 2 * COLOUR_REACH * divisor + 1
    wanted = walls.examples & (cv2.dilate(walls.doubtful.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
    spacing = spacing_of(divisor)
    grid, nodes = every(walls.grid, walls.window, spacing)
    rows = np.arange(nodes.row, nodes.row + nodes.height) * spacing - walls.window.row
    cols = np.arange(nodes.col, nodes.col + nodes.width) * spacing - walls.window.col
    at = np.ix_(rows, cols)
    z = np.where(walls.side[at] == Side.UPPER, walls.upper[at], walls.lower[at])
    z, flat = np.where(wanted[at], z, np.float32(np.nan)), np.zeros(z.shape, np.float32)
    ground = Ground(grid, nodes, z, flat, flat)
    x, y = grid.centres(nodes)
    targets = Targets(*certain.grid.pixel(x, y)[::-1], z, flat)
    total, squares = np.zeros((2, *z.shape, bands_of(photos)), np.float32)
    weights = np.zeros(z.shape, np.float32)
    for photo in photos:
        # Ground that a roof hides would show the roof.
        seen = visible_targets(certain, photo.view, targets, 0.5 * certain.grid.cell)
        sampled = photo.on(ground, seen.astype(np.float32), 0.0, total.shape[2])
        total += sampled.weight[..., None] * sampled.colour
        squares += sampled.weight[..., None] * sampled.colour**2
        weights += sampled.weight
    each = np.where(weights > 0, weights, 1)[..., None]
    colours = (total / each).astype(np.float32)
    # The model's roofs may be too wide: beyond its edge every photograph shows another place, and their mean is the colour of none.
    apart = np.sqrt(np.maximum(squares / each - colours**2, 0)).mean(axis=2)
    known = (weights > 0) & ((walls.side[at] == Side.LOWER) | (apart < _SAME))
    sides = np.where(known, walls.side[at], Side.NEITHER).astype(np.uint8)
    return Examples(colours, sides, (nodes.row, nodes.col), spacing)
