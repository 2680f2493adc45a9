"""Comparison of an orthoimage with the true one: grey values, structure, position, double projections and vehicles.

- The absolute brightness of a block is free, so the grey values are compared after one linear fit per channel over the whole image
  (and also unadjusted).
- Structure: SSIM with a Gaussian window of sigma 1.5 px on the mean of the channels (Wang et al. 2004).
- Position: least-squares matching of the true image in the orthoimage at the nodes of a grid; shifts in ortho pixels.
- Double projection: the second image of a roof lies on ground that the building hides from some photograph. There, a pixel that is
  far from its true colour and closer to that of the adjacent roof counts as doubled. The same rule on ground that no building hides
  from any photograph shows how often it applies by chance.
- Edges of roofs: their departure from a straight line (`roof_lines.py`).
- Vehicles: road pixels far from their vehicle-free truth, where three photographs or more show the place.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy import ndimage

from orthomill.schemas.job import Columns
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import HeightSource
from orthomill.schemas.truth import OPEN_MATERIALS, Material
from orthomill.tasks.evaluation.classes import PlaceClass
from orthomill.tasks.evaluation.orientation_accuracy import datum_shifts
from orthomill.tasks.evaluation.roof_lines import edge_lines
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import match_points

HALO = 34
"""pixels around a tile: matching window with smoothing and pull-in range, and distance to the nearest roof"""
FAR = 40.0
"""grey levels beyond which a pixel shows another object, not the same object in another light"""
NODES = 32
"""spacing of the nodes at which the shift is measured, px"""
NEAR_ROOF = 30
"""pixels within which a doubled roof is attributed to a building"""
SSIM_REACH = 5
"""half-width of the window of the structural similarity, px"""
MATCHING = LeastSquaresMatching(window=25, max_shift=4.0, min_correlation=0.5, min_gradient=0.8)


class GreySums(BaseModel):
    """Sums over the pixels of a tile that both images have, per channel: ortho o, truth t."""

    model_config = ConfigDict(frozen=True)

    pixels: int
    o: tuple[float, ...]
    t: tuple[float, ...]
    oo: tuple[float, ...]
    tt: tuple[float, ...]
    ot: tuple[float, ...]


class GreyFit(BaseModel):
    """truth = gain ortho + offset per channel, over the whole image."""

    model_config = ConfigDict(frozen=True)

    gain: tuple[float, ...] = (1.0, 1.0, 1.0)
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    pixels: int = 0
    psnr_raw: float | None = None
    psnr: float | None = None


class OrthoCounts(BaseModel):
    """Quality of one tile of the orthoimage. Every count is of pixels."""

    model_config = ConfigDict(frozen=True)

    ssim_sum: float = 0.0
    ssim_count: int = 0
    visible: int = 0
    visible_covered: int = 0
    visible_modelled: int = 0
    visible_modelled_covered: int = 0
    hidden: int = 0
    hidden_covered: int = 0
    shadow: int = 0
    shadow_doubled: int = 0
    shadow_doubled_apart: int = 0
    """those of the doubled that do not touch the roof: a second image, and not its displaced edge"""
    free: int = 0
    free_doubled: int = 0
    road_3: int = 0
    road_3_far: int = 0
    road_fewer: int = 0
    road_fewer_far: int = 0
    edge_squares: float = 0.0
    """px^2: sum of the squared departures of roof edges from their best straight line"""
    edge_places: int = 0
    difference_absolute: float = 0.0
    difference_count: int = 0


@dataclass(frozen=True)
class Shifts(Columns):
    """Shift of the orthoimage against the truth at one node: ortho minus truth, px of the orthoimage, row downwards."""

    col: np.ndarray
    row: np.ndarray
    """int32: node in the orthoimage"""
    dx: np.ndarray
    dy: np.ndarray
    """float32; NaN where matching failed"""
    place: np.ndarray
    """uint8: code of PlaceClass, 0 not known; VEHICLE or WATER where the matching window contains some"""
    seen: np.ndarray
    """uint8: photographs that truly show the node; 255 not known"""
    measured: np.ndarray
    """bool: all heights in the matching window are measured"""
    datum_dx: np.ndarray
    datum_dy: np.ndarray
    """float32 px: what the adjusted orientations alone shift; NaN where the true ones are not known"""


def grey_sums(ortho: np.ndarray, truth: np.ndarray) -> GreySums:
    """Sums over pixels with alpha in `ortho` (rows, cols, 4) uint8 and values in `truth` (rows, cols, 3) float32."""
    # sums and not images: the fit of a whole orthoimage needs six numbers per channel and tile
    both = (ortho[..., 3] > 0) & _complete(truth)
    channels = [(ortho[..., band][both].astype(np.float64), truth[..., band][both].astype(np.float64)) for band in range(3)]
    o, t, oo, tt, ot = zip(*((o.sum(), t.sum(), o @ o, t @ t, o @ t) for o, t in channels), strict=True)
    return GreySums(pixels=int(both.sum()), o=o, t=t, oo=oo, tt=tt, ot=ot)


def _complete(colours: np.ndarray) -> np.ndarray:
    """Where all channels of (rows, cols, 3) have a value."""
    # channel by channel: many times faster than a reduction over a short last axis
    return np.isfinite(colours[..., 0]) & np.isfinite(colours[..., 1]) & np.isfinite(colours[..., 2])


def channel_mean(colours: np.ndarray) -> np.ndarray:
    """Mean (...) of the channels of (..., 3)."""
    return (colours[..., 0] + colours[..., 1] + colours[..., 2]) / colours.dtype.type(3)


def _psnr(squares: float, values: float) -> float | None:
    return float(10 * np.log10(255.0**2 * values / squares)) if values and squares > 0 else None


def fit_grey(parts: tuple[GreySums, ...]) -> GreyFit:
    """The linear fit per channel over all tiles, and the peak signal-to-noise ratio before and after it (dB; peak 255)."""
    n = sum(p.pixels for p in parts)
    if not n:
        return GreyFit()
    o, t, oo, tt, ot = (np.sum([getattr(p, name) for p in parts], axis=0) for name in ("o", "t", "oo", "tt", "ot"))
    # a channel of constant grey determines no gain
    variance = oo - o * o / n
    gain = np.where(variance > 1e-9 * n, (ot - o * t / n) / np.maximum(variance, 1e-9), 1.0)
    offset = (t - gain * o) / n
    raw = (oo - 2 * ot + tt).sum()
    fitted = (gain**2 * oo + 2 * gain * offset * o + n * offset**2 - 2 * gain * ot - 2 * offset * t + tt).sum()
    return GreyFit(gain=tuple(gain), offset=tuple(offset), pixels=n, psnr_raw=_psnr(raw, 3 * n), psnr=_psnr(fitted, 3 * n))


def fitted(ortho: np.ndarray, fit: GreyFit) -> np.ndarray:
    """float32 (rows, cols, 3): the orthoimage's colours in the brightness of the truth."""
    return ortho[..., :3] * np.array(fit.gain, np.float32) + np.array(fit.offset, np.float32)


def structural_similarity(a: np.ndarray, b: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """SSIM (rows, cols) of two grey images; NaN where the 11 x 11 window contains a pixel that is not `valid` or extends beyond
    the arrays."""

    def smooth(x: np.ndarray) -> np.ndarray:
        return ndimage.gaussian_filter(x, 1.5, truncate=3.4, mode="nearest")

    a, b = (np.where(valid, x, 0).astype(np.float64) for x in (a, b))
    ma, mb = smooth(a), smooth(b)
    va, vb, vab = smooth(a * a) - ma**2, smooth(b * b) - mb**2, smooth(a * b) - ma * mb
    # the constants of Wang et al. 2004 (K1 = 0.01, K2 = 0.03, L = 255) keep flat windows from dividing by zero
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    index = (2 * ma * mb + c1) * (2 * vab + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))
    whole = ndimage.minimum_filter(valid.astype(np.uint8), size=2 * SSIM_REACH + 1, mode="constant", cval=0) > 0
    return np.where(whole, index, np.nan)


@dataclass(frozen=True)
class OrthoScene:
    """A window of the orthoimage with its truth.

    `window` in the ortho grid; `colour` (rows, cols, 3) fitted ortho colours; `truth` likewise, NaN where unknown; `covered` (rows,
    cols) bool: the orthoimage has a colour; `material` codes; `seen` uint8 number of photographs that truly show the pixel, 255
    where unknown; `source` (rows, cols) codes of HeightSource: the height that the orthoimage rests on.
    """

    window: Window
    colour: np.ndarray
    truth: np.ndarray
    covered: np.ndarray
    material: np.ndarray
    seen: np.ndarray
    source: np.ndarray

    @cached_property
    def measured(self) -> np.ndarray:
        """(rows, cols) bool: the pixel rests on a measured height."""
        return self.source == HeightSource.MEASURED

    @cached_property
    def has_truth(self) -> np.ndarray:
        """(rows, cols) bool: the true colour is known in all bands."""
        return _complete(self.truth)

    @cached_property
    def judged(self) -> np.ndarray:
        """(rows, cols) bool: both orthoimage and truth have a colour."""
        return self.covered & self.has_truth

    @cached_property
    def known(self) -> np.ndarray:
        """(rows, cols) bool: true colour and number of photographs are known."""
        return self.has_truth & (self.seen != 255)

    @cached_property
    def grey(self) -> np.ndarray:
        """(rows, cols): mean of the channels of the orthoimage"""
        return channel_mean(self.colour)

    @cached_property
    def true_grey(self) -> np.ndarray:
        """(rows, cols): mean of the channels of the truth, NaN where unknown"""
        return channel_mean(self.truth)

    @cached_property
    def difference(self) -> np.ndarray:
        """(rows, cols, 3): absolute difference of the orthoimage from the truth"""
        return np.abs(self.colour - self.truth)


def shifts(scene: OrthoScene, core: Window, place: np.ndarray) -> Shifts:
    """Shifts at the nodes of `core` (in the ortho grid); `place` (rows, cols) codes of PlaceClass on the scene."""
    # multiples of the spacing in the whole grid: every node belongs to one tile, whatever the tiling
    rows = np.arange(-(-core.row // NODES) * NODES, core.row + core.height, NODES)
    cols = np.arange(-(-core.col // NODES) * NODES, core.col + core.width, NODES)
    row, col = (a.ravel() for a in np.meshgrid(rows, cols, indexing="ij"))
    r, c = row - scene.window.row, col - scene.window.col
    if not len(r):
        types = (np.int32, np.int32, np.float32, np.float32, np.uint8, np.uint8, bool, np.float32, np.float32)
        return Shifts(*(np.zeros(0, t) for t in types))
    grey, truth = (np.where(scene.judged, np.maximum(x, 1.0), np.nan).astype(np.float32) for x in (scene.grey, scene.true_grey))
    points = np.column_stack([c, r]).astype(np.float64)
    # the truth is the template: its noise is zero, and the gradients come from it
    found = match_points(truth, grey, points, points, MATCHING)
    return Shifts(
        col.astype(np.int32),
        row.astype(np.int32),
        (found.col - c).astype(np.float32),
        (found.row - r).astype(np.float32),
        _moving_near(scene.material, place)[r, c],
        scene.seen[r, c],
        ndimage.minimum_filter(scene.measured, MATCHING.window, mode="nearest")[r, c],
        *np.full((2, len(r)), np.nan, np.float32),
    )


def _moving_near(material: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Codes of PlaceClass (rows, cols), VEHICLE or WATER wherever a matching window contains some."""
    # The truth has neither cars nor glints: with true heights, 29 of 32 large shifts were matches of a road with cars or of glints.
    for own, code in ((Material.WATER, PlaceClass.WATER), (Material.VEHICLE, PlaceClass.VEHICLE)):
        near = ndimage.maximum_filter(material == own, size=MATCHING.window, mode="constant", cval=0)
        place = np.where(near, np.uint8(code), place)
    return place


def with_datum(found: Shifts, scene: OrthoScene, grid: MapGrid, height: np.ndarray, blocks: tuple[Block, Block]) -> Shifts:
    """The shifts with those of the datum; `height` (rows, cols) m of the scene, NaN where unknown; `blocks`: adjusted and true."""
    x, y = grid.centres(scene.window)
    row, col = found.row - scene.window.row, found.col - scene.window.col
    moved = datum_shifts(*blocks, np.column_stack([x[col], y[row], height[row, col]])) / grid.cell
    # rows count southwards
    return replace(found, datum_dx=moved[:, 0].astype(np.float32), datum_dy=-moved[:, 1].astype(np.float32))


def doubled(scene: OrthoScene) -> np.ndarray:
    """Ground pixels (rows, cols) that are far from their own colour and closer to that of the adjacent roof."""
    roof = (scene.material == Material.ROOF) & scene.has_truth
    # the colour of the roof interior: at its edge the truth itself mixes roof and ground
    inner = ndimage.binary_erosion(roof, iterations=2)
    own = channel_mean(scene.difference)
    twice = scene.judged & is_ground(scene.material) & (own > FAR)
    if not inner.any() or not twice.any():
        return np.zeros(roof.shape, bool)
    distance, (row, col) = ndimage.distance_transform_edt(~inner, return_indices=True)
    # relief displacement of a roof at the edge of a photograph is of the order of its height; farther away it is another object
    twice &= distance <= NEAR_ROOF
    beside = scene.truth[row[twice], col[twice]]
    # clearly closer, by half: brown fields next to brown roofs would otherwise count
    other = channel_mean(np.abs(scene.colour[twice] - beside))
    twice[twice] = other < 0.5 * own[twice]
    return twice


def touches(roof: np.ndarray) -> np.ndarray:
    """Pixels (rows, cols) that have one of `roof` among their eight neighbours."""
    return ndimage.binary_dilation(roof, np.ones((3, 3)))


def is_ground(material: np.ndarray) -> np.ndarray:
    """Bare ground (rows, cols) bool."""
    return np.logical_or.reduce([material == code for code in OPEN_MATERIALS])


def photos_that_reach(block: Block, points: np.ndarray) -> np.ndarray:
    """Number (N,) of photographs whose frame contains the ground points (N, 3) m, occluded or not."""
    count = np.zeros(len(points), np.int64)
    for name in block.names:
        view = block_view(block, name)
        count += view.contains(view.project(points))
    return count


def _similarity_in(scene: OrthoScene, core: Window) -> np.ndarray:
    """SSIM (rows, cols) of the pixels of `core`, a window of the scene's own rows and columns."""
    # the scene has a halo for matching; smoothing all of it would double the time of the job
    near = core.grown(SSIM_REACH).clipped(scene.covered.shape)
    index = structural_similarity(*(values[near.slices] for values in (scene.grey, scene.true_grey, scene.judged)))
    return index[core.within(near).slices]


def count_ortho(scene: OrthoScene, core: Window, hidden_photos: np.ndarray) -> OrthoCounts:
    """The counts of the pixels of `core`.

    `hidden_photos` (rows, cols) on the scene: photographs from which the pixel is hidden; -1 where not computed.
    """
    own_core = core.within(scene.window)
    inner = own_core.slices
    own = [scene.difference[..., band][inner] for band in range(3)]
    # on the tile alone; everything else needs no neighbourhood
    index = _similarity_in(scene, own_core)
    known, covered, seen, judged = scene.known[inner], scene.covered[inner], scene.seen[inner], scene.judged[inner]
    ground, twice = is_ground(scene.material)[inner], doubled(scene)[inner]
    # ground in the shadow of a building is the sample, free ground the control group of the rule for doubled roofs
    hidden = hidden_photos[inner]
    # Where one photograph shows the ground its height, and with it what hides it, is a guess: as for shifts, two must show it.
    twice_seen = ground & judged & (seen >= 2)
    shadow, free = twice_seen & (hidden > 0), twice_seen & (hidden == 0)
    # roads only: vehicles are found there, and the truth contains the road without them
    road = judged & known & np.isin(scene.material[inner], (Material.ROAD, Material.VEHICLE))
    # any channel: a red car on grey asphalt may differ in one of them only
    far = (own[0] > FAR) | (own[1] > FAR) | (own[2] > FAR)
    many, few = road & (seen >= 3), road & (seen < 3) & (seen > 0)
    # Beyond the surface model heights are a guess, and with them the place where the frame of the last photograph ends.
    modelled = np.isin(scene.source[inner], (HeightSource.MEASURED, HeightSource.ESTIMATED))
    counts = {
        "ssim_count": np.isfinite(index),
        "visible": known & (seen > 0),
        "visible_covered": known & (seen > 0) & covered,
        "visible_modelled": known & (seen > 0) & modelled,
        "visible_modelled_covered": known & (seen > 0) & modelled & covered,
        "hidden": known & (seen == 0),
        "hidden_covered": known & (seen == 0) & covered,
        "shadow": shadow,
        "shadow_doubled": shadow & twice,
        "shadow_doubled_apart": shadow & twice & ~touches(scene.material == Material.ROOF)[inner],
        "free": free,
        "free_doubled": free & twice,
        "road_3": many,
        "road_3_far": many & far,
        "road_fewer": few,
        "road_fewer_far": few & far,
        "difference_count": judged,
    }
    grey, true = (np.where(scene.judged, image, np.nan) for image in (scene.grey, scene.true_grey))
    # Where one photograph shows an edge there is no height to be straight or not.
    roof, seen_twice = scene.material == Material.ROOF, (scene.seen != 255) & (scene.seen >= 2)
    edges = edge_lines(grey, true, roof, seen_twice, (scene.window.row, scene.window.col), inner)
    absolute = float(channel_mean(scene.difference)[inner][judged].sum())
    return OrthoCounts(
        ssim_sum=float(np.nansum(index)),
        difference_absolute=absolute,
        edge_squares=edges.squares,
        edge_places=edges.places,
        **{name: int(mask.sum()) for name, mask in counts.items()},
    )


def merged_counts(parts: tuple[OrthoCounts, ...]) -> OrthoCounts:
    """The sum over all tiles."""
    return OrthoCounts(**{name: sum(getattr(part, name) for part in parts) for name in OrthoCounts.model_fields})
