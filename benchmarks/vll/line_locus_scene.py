"""Scenes as in the published study of vertical line locus: f = 100 mm, 1:8000, 0.34 m pixels, 100 m of relief, three covers.

Strategy. The ground is a slope of four degrees with gentle waves, known everywhere; the grid has 101 x 59 nodes 10 m apart. Covers
are painted on the ground and seen by two vertical photographs without distortion; each gets noise of its own. The overlap of the
published pairs is not printed; 60 % of a frame of 180 mm is assumed, so that the base is 576 m. Only the part of the frames around
the grid is made.

1: uniform fields with weak texture, parted by roads; 2: a mosaic with a pattern that repeats every few metres and large jumps of
brightness; 3: eroded land, rich in texture of all sizes.

Source: Tumska, Procyk, Janczak (sources/line_locus.md#results, #data).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from orthomill.schemas.camera import Camera
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.matching.line_locus.window_correlation import GreyImage

PIXEL_MM, C_MM, SCALE, BASE = 0.04233, 100.0, 8000.0, 576.0
FLYING_HEIGHT, MIDDLE = 850.0, 50.0
"""m: the ground lies between 0 and 100 m"""
COVERS = ("1, uniform fields", "2, repeating mosaic", "3, eroded land")
ROWS, COLS, STEP = 101, 59, 10.0
"""the grid of the published area 1: 5959 nodes"""
WEST, NORTH = 210.0, 1060.0
"""m: the first node"""
_GROUND = 0.25
"""m: pixels in which the covers are painted"""
Ground = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""heights m at X and Y"""
_EXTENT = 700.0, 1140.0
_NOISE, _BLUR = 2.0, 0.6
"""grey levels and px of a photograph"""


@dataclass(frozen=True)
class LocusPair:
    """Two photographs of a scene as a block and as images, with their ground."""

    block: Block
    images: tuple[np.ndarray, np.ndarray]

    @property
    def views(self) -> tuple[View, View]:
        return block_view(self.block, "left"), block_view(self.block, "right")

    def grey(self) -> list[GreyImage]:
        """The images as the search takes them."""
        return [GreyImage(image.astype(np.float32), view.numbers) for image, view in zip(self.images, self.views, strict=True)]


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The ground, m: it rises four degrees towards the north, with waves of 500 and 330 m."""
    return 3.0 + 0.07 * y + 7.0 * (1 + np.sin(2 * np.pi * x / 500.0)) + 4.0 * (1 + np.sin(2 * np.pi * y / 330.0 + x / 90.0))


def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The same slope without waves, m."""
    return 14.0 + 0.07 * y + 0.0 * x


def nodes() -> tuple[np.ndarray, np.ndarray]:
    """X of the columns and Y of the rows."""
    return WEST + STEP * np.arange(COLS), NORTH - STEP * np.arange(ROWS)


def located_pair(cover: int, seed: int = 11, ground: Ground = height) -> LocusPair:
    """The photographs of a cover (0, 1 or 2) on a ground."""
    block, painted = _block(), _painted(cover, np.random.default_rng(seed + cover))
    rng = np.random.default_rng(100 * seed + cover)
    images = [_photograph(block_view(block, name), painted, rng, ground) for name in ("left", "right")]
    return LocusPair(block, (images[0], images[1]))


def _block() -> Block:
    c = C_MM / PIXEL_MM
    middle = WEST + STEP * (COLS - 1) / 2, NORTH - STEP * (ROWS - 1) / 2
    ground_pixel = (FLYING_HEIGHT - MIDDLE) / c
    size = int(1.12 * STEP * COLS / ground_pixel) + 300, int(1.08 * STEP * ROWS / ground_pixel) + 300
    stations = {"left": middle[0] - BASE / 2, "right": middle[0] + BASE / 2}
    # The frame is cut to the grid: the principal point lies where it lies in the whole one, far to the side.
    cameras = {
        name: Camera(name=name, width=size[0], height=size[1], c=c, x0=(x - middle[0]) / ground_pixel, y0=0.0)
        for name, x in stations.items()
    }
    photos = tuple(
        ExteriorOrientation(photo=name, centre=(x, middle[1], FLYING_HEIGHT), omega_phi_kappa=(0.0, 0.0, 0.0))
        for name, x in stations.items()
    )
    return Block(
        crs="EPSG:2100", cameras=cameras, of_photo={name: name for name in cameras}, photos=photos, datum="control",
        sigma0_px=0.3, redundancy=100, iterations=1, ground_low=5.0, ground_high=105.0,
    )  # fmt: skip


def _photograph(view: View, painted: np.ndarray, rng: np.random.Generator, ground: Ground) -> np.ndarray:
    """What a photograph shows of the painted ground, uint8."""
    n = view.numbers
    col, row = np.meshgrid(np.arange(view.camera.width), np.arange(view.camera.height))
    right, down = (col - n.col0) / n.c, (row - n.row0) / n.c
    z = np.full(col.shape, MIDDLE)
    for _ in range(12):  # slopes of the ground times those of the rays are below 0.1: every step gains a digit
        z = ground(n.xc + right * (n.zc - z), n.yc - down * (n.zc - z))
    x, y = n.xc + right * (n.zc - z), n.yc - down * (n.zc - z)
    grey = ndimage.map_coordinates(painted, [(_EXTENT[1] - y) / _GROUND, (x - WEST + 60.0) / _GROUND], order=1, mode="nearest")
    grey = ndimage.gaussian_filter(grey, _BLUR) + rng.normal(0.0, _NOISE, grey.shape)
    return np.clip(np.rint(grey), 1, 255).astype(np.uint8)


def _noise(shape: tuple[int, int], metres: float, rng: np.random.Generator) -> np.ndarray:
    """Random texture of a grain, standard deviation 1."""
    factor = max(1, int(metres / _GROUND / 2))
    coarse = rng.normal(0, 1, (shape[0] // factor + 4, shape[1] // factor + 4))
    fine = ndimage.zoom(ndimage.gaussian_filter(coarse, 1.0), factor, order=1)[: shape[0], : shape[1]]
    return fine / fine.std()


def _painted(cover: int, rng: np.random.Generator) -> np.ndarray:
    shape = int(_EXTENT[1] / _GROUND) + 80, int(_EXTENT[0] / _GROUND) + 80
    return (_fields, _mosaic, _eroded)[cover](shape, rng).astype(np.float32)


def _parcels(shape: tuple[int, int], side: float, levels: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Grey values of parcels of about `side` m, and where their borders are."""
    y, x = np.mgrid[: shape[0], : shape[1]] * _GROUND
    u = (x * 0.97 + y * 0.24) / side + 0.12 * np.sin(y / 70.0)
    v = (y * 0.97 - x * 0.24) / (1.6 * side)
    number = (np.floor(u).astype(int) * 7919 + np.floor(v).astype(int) * 104729) % 4096
    border = np.minimum(np.abs(u - np.rint(u)) * side, np.abs(v - np.rint(v)) * 1.6 * side)
    return rng.normal(0, levels, 4096)[number], border


def _fields(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    grey, border = _parcels(shape, 90.0, 12.0, rng)
    texture = 0.5 * _noise(shape, 1.5, rng) + 0.35 * _noise(shape, 6.0, rng)
    road = np.where(border < 3.0, 45.0 + 6.0 * _noise(shape, 1.0, rng), 0.0)
    return 110.0 + grey + texture + road


def _mosaic(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    grey, border = _parcels(shape, 60.0, 35.0, rng)
    y, x = np.mgrid[: shape[0], : shape[1]] * _GROUND
    # Haystacks in rows: the same small heap every nine metres.
    heap = np.exp(-(((x % 9.0) - 4.5) ** 2 + ((y % 9.0) - 4.5) ** 2) / (2 * 1.1**2))
    stacked = (np.floor((x * 0.97 + y * 0.24) / 60.0).astype(int) % 2 == 0) & (border > 4.0)
    return 110.0 + grey + np.where(stacked, 40.0 * heap, 0.0) + 1.2 * _noise(shape, 1.5, rng) + 1.5 * _noise(shape, 20.0, rng)


def _eroded(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    return 120.0 + sum(6.0 * (grain / 8.0) ** 0.35 * _noise(shape, grain, rng) for grain in (1.0, 2.0, 4.0, 8.0, 16.0, 48.0))
