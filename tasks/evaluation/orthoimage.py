"""How an orthoimage compares with the true one: grey values, structure, place, double projections and vehicles.

- The absolute brightness of a block is free, so the grey values are compared after one linear fit per channel over the whole image
  (and also as they are).
- Structure: SSIM with a Gaussian window of sigma 1.5 px on the mean of the channels (Wang et al. 2004).
- Place: least-squares matching of the true image in the orthoimage at nodes of a grid; the shift of each node in ortho pixels.
- Double projection: a roof that is painted twice lies on ground which some photo cannot see for the building. There, a pixel that
is far from its true colour and nearer to that of the roof beside it counts as doubled. The same rule on ground that no building
hides from any photo tells how often it strikes by chance.
- Vehicles: road pixels far from their vehicle-free truth, where three photos or more see the place.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy import ndimage

from schemas.job import Columns
from schemas.orientation import Block
from schemas.raster import Window
from schemas.truth import OPEN_MATERIALS, Material
from tasks.geometry.view import block_view
from tasks.matching.least_squares import LeastSquaresMatching, match_points

HALO = 34
"""Pixels around a tile: the matching window with its smoothing and pull-in range, and the way to the nearest roof."""
FAR = 40.0
"""Grey levels beyond which a pixel is another thing, not the same thing in another light."""
NODES = 32
"""Spacing of the nodes at which the shift is measured, px."""
NEAR_ROOF = 30
"""Pixels within which a building is sought for a doubled roof."""
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
    """What one tile of the orthoimage is like. Every count is of pixels."""

    model_config = ConfigDict(frozen=True)

    ssim_sum: float = 0.0
    ssim_count: int = 0
    visible: int = 0
    visible_covered: int = 0
    hidden: int = 0
    hidden_covered: int = 0
    shadow: int = 0
    shadow_doubled: int = 0
    free: int = 0
    free_doubled: int = 0
    road_3: int = 0
    road_3_far: int = 0
    road_fewer: int = 0
    road_fewer_far: int = 0
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
    """uint8: code of PlaceClass, 0 not known"""
    seen: np.ndarray
    """uint8: photos that truly see the node; 255 not known"""


def grey_sums(ortho: np.ndarray, truth: np.ndarray) -> GreySums:
    """Sums over pixels with alpha in `ortho` (rows, cols, 4) uint8 and values in `truth` (rows, cols, 3) float32."""
    both = (ortho[..., 3] > 0) & np.isfinite(truth).all(axis=-1)
    o, t = ortho[..., :3][both].astype(np.float64), truth[both].astype(np.float64)
    return GreySums(pixels=len(o), o=tuple(o.sum(0)), t=tuple(t.sum(0)), oo=tuple((o * o).sum(0)), tt=tuple((t * t).sum(0)),
                    ot=tuple((o * t).sum(0)))


def _psnr(squares: float, values: float) -> float | None:
    return float(10 * np.log10(255.0**2 * values / squares)) if values and squares > 0 else None


def fit_grey(parts: tuple[GreySums, ...]) -> GreyFit:
    """The linear fit per channel over all tiles, and the peak signal-to-noise ratio before and after it (dB; peak 255)."""
    n = sum(p.pixels for p in parts)
    if not n:
        return GreyFit()
    o, t, oo, tt, ot = (np.sum([getattr(p, name) for p in parts], axis=0) for name in ("o", "t", "oo", "tt", "ot"))
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
    """SSIM (rows, cols) of two grey images; NaN where the 11 x 11 window touches a pixel that is not `valid` or leaves the
    arrays."""
    def smooth(x: np.ndarray) -> np.ndarray:
        return ndimage.gaussian_filter(x, 1.5, truncate=3.4, mode="nearest")

    a, b = (np.where(valid, x, 0).astype(np.float64) for x in (a, b))
    ma, mb = smooth(a), smooth(b)
    va, vb, vab = smooth(a * a) - ma**2, smooth(b * b) - mb**2, smooth(a * b) - ma * mb
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    index = (2 * ma * mb + c1) * (2 * vab + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))
    whole = ndimage.minimum_filter(valid.astype(np.uint8), size=11, mode="constant", cval=0) > 0
    return np.where(whole, index, np.nan)


@dataclass(frozen=True)
class OrthoScene:
    """A window of the orthoimage with what is true there.

    `window` in the ortho grid; `colour` (rows, cols, 3) fitted ortho colours; `truth` likewise, NaN where unknown; `covered` (rows,
    cols) bool: the orthoimage has a colour; `material` codes; `seen` uint8 number of photos that truly see the pixel, 255 where
    unknown.
    """

    window: Window
    colour: np.ndarray
    truth: np.ndarray
    covered: np.ndarray
    material: np.ndarray
    seen: np.ndarray

    @property
    def judged(self) -> np.ndarray:
        return self.covered & np.isfinite(self.truth).all(axis=-1)

    @property
    def known(self) -> np.ndarray:
        return np.isfinite(self.truth).all(axis=-1) & (self.seen != 255)


def shifts(scene: OrthoScene, core: Window, place: np.ndarray) -> Shifts:
    """Shifts at the nodes of `core` (in the ortho grid); `place` (rows, cols) codes of PlaceClass on the scene."""
    rows = np.arange(-(-core.row // NODES) * NODES, core.row + core.height, NODES)
    cols = np.arange(-(-core.col // NODES) * NODES, core.col + core.width, NODES)
    row, col = (a.ravel() for a in np.meshgrid(rows, cols, indexing="ij"))
    r, c = row - scene.window.row, col - scene.window.col
    if not len(r):
        return Shifts(*(np.zeros(0, t) for t in (np.int32, np.int32, np.float32, np.float32, np.uint8, np.uint8)))
    grey, truth = (np.where(scene.judged, np.maximum(x.mean(axis=-1), 1.0), np.nan).astype(np.float32)
                   for x in (scene.colour, scene.truth))
    points = np.column_stack([c, r]).astype(np.float64)
    found = match_points(truth, grey, points, points, MATCHING)
    return Shifts(col.astype(np.int32), row.astype(np.int32), (found.col - c).astype(np.float32),
                  (found.row - r).astype(np.float32),
                  place[r, c], scene.seen[r, c])


def doubled(scene: OrthoScene) -> np.ndarray:
    """Ground pixels (rows, cols) that are far from their own colour and nearer to that of the roof beside them."""
    roof = (scene.material == Material.ROOF) & np.isfinite(scene.truth).all(axis=-1)
    inner = ndimage.binary_erosion(roof, iterations=2)
    if not inner.any():
        return np.zeros(roof.shape, bool)
    distance, (row, col) = ndimage.distance_transform_edt(~inner, return_indices=True)
    beside = scene.truth[row, col]
    own = np.abs(scene.colour - scene.truth).mean(axis=-1)
    other = np.abs(scene.colour - beside).mean(axis=-1)
    return scene.judged & is_ground(scene.material) & (distance <= NEAR_ROOF) & (own > FAR) & (other < 0.5 * own)


def is_ground(material: np.ndarray) -> np.ndarray:
    """Bare ground (rows, cols) bool."""
    return np.isin(material, [int(code) for code in OPEN_MATERIALS])


def photos_that_reach(block: Block, points: np.ndarray) -> np.ndarray:
    """Number (N,) of photos whose frame contains the ground points (N, 3) m, whatever stands in the way."""
    count = np.zeros(len(points), np.int64)
    for name in block.names:
        view = block_view(block, name)
        count += view.contains(view.project(points))
    return count


def count_ortho(scene: OrthoScene, core: Window, hidden_photos: np.ndarray) -> OrthoCounts:
    """The counts of the pixels of `core`.

    `hidden_photos` (rows, cols) on the scene: photos that would see the pixel if nothing stood in the way; -1 where not computed.
    """
    inner = Window(core.row - scene.window.row, core.col - scene.window.col, core.height, core.width).slices
    own = np.abs(scene.colour - scene.truth)
    index = structural_similarity(scene.colour.mean(axis=-1), np.nan_to_num(scene.truth).mean(axis=-1), scene.judged)[inner]
    known, covered, seen, judged = scene.known[inner], scene.covered[inner], scene.seen[inner], scene.judged[inner]
    ground, twice = is_ground(scene.material)[inner], doubled(scene)[inner]
    hidden = hidden_photos[inner]
    shadow, free = ground & judged & (hidden > 0), ground & judged & (hidden == 0)
    road = judged & known & (scene.material[inner] == Material.ROAD)
    far = own[inner].max(axis=-1) > FAR
    many, few = road & (seen >= 3), road & (seen < 3) & (seen > 0)
    counts = {
        "ssim_count": np.isfinite(index), "visible": known & (seen > 0), "visible_covered": known & (seen > 0) & covered,
        "hidden": known & (seen == 0), "hidden_covered": known & (seen == 0) & covered, "shadow": shadow,
        "shadow_doubled": shadow & twice,
        "free": free, "free_doubled": free & twice, "road_3": many, "road_3_far": many & far, "road_fewer": few,
        "road_fewer_far": few & far, "difference_count": judged,
    }
    return OrthoCounts(ssim_sum=float(np.nansum(index)), difference_absolute=float(own[inner][judged].mean(axis=-1).sum()),
                       **{name: int(mask.sum()) for name, mask in counts.items()})


def merged_counts(parts: tuple[OrthoCounts, ...]) -> OrthoCounts:
    """The sum over all tiles."""
    return OrthoCounts(**{name: sum(getattr(part, name) for part in parts) for name in OrthoCounts.model_fields})
