"""A mountain, rendered: slopes of mostly 28 to 41 degrees, three vertical photographs of 0.6 m pixels.

Strategy. The ground is a formula, so that its height is known everywhere; grain of all sizes is painted on it, seen by photographs
without distortion, each with noise of its own. Tie points lie every 60 m, as sparse as on a real mountain.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from scipy import ndimage

from benchmarks.compare.compared_ground import Known, Scene, exact_model
from benchmarks.compare.replayed_crop import Crop
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.camera import Camera
from orthomill.schemas.observations import GROUND_POINTS, IMAGE_RESIDUALS, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import BLOCK, Block, ExteriorOrientation
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.project import PhotoList, Project
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.surface import SURFACE
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.evaluation.classes import PlaceClass
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.imagery.pyramid import halved
from orthomill.temporary_run import GivenResults, temporary_run

C, FLYING_HEIGHT, BASE = 2400.0, 1750.0, 380.0
SIZE = 1000, 800
_NAMES = ("one", "two", "three")
_CELL, _PAINTED, _HALF = 1.0, 0.4, 900.0
"""m: of the surface; of the paint; half the side of what is painted"""
_LEVELS = 4
_GROSS = 7.0
"""m: three pixels of parallax between neighbouring photographs"""


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The ground, m: a cone with ridges and gullies on rolling hills."""
    away = np.hypot(x, y)
    turned = np.arctan2(y, x)
    cone = 340.0 * np.exp(-((away / 380.0) ** 2)) * (1.0 + 0.04 * np.cos(7.0 * turned) * np.minimum(away / 150.0, 1.0))
    return 60.0 + cone + 15.0 * np.sin(x / 90.0) * np.cos(y / 110.0)


@contextmanager
def mountain() -> Iterator[Scene]:
    """The scene, with epipolar images; its run lasts as long as the context."""
    block = _block()
    given = GivenResults.of(_tables(block), _rasters(block))
    project = Project(project="mountain", crs=block.crs, photographs=PhotoList(kind="list", paths=_NAMES))
    # Any way to heights makes the grid of the surface, which is all that is needed of it.
    lines = DensificationStage.model_validate({"kind": "densification", "cell": _CELL, "matching": {"kind": "vertical_line_locus"}})
    with temporary_run(project, (given, EpipolarStage(), lines)) as store:
        yield _scene(store)


def _scene(store: Store) -> Scene:
    grid = store.table(SURFACE).grid
    side = 440
    window = Window((grid.rows - side) // 2, (grid.cols - side) // 2, side, side).clipped(grid.shape)
    crop = Crop(store, window)
    truth = np.asarray(height(*np.meshgrid(*crop.surface.grid.centres(Window(0, 0, *window.shape)))))
    everywhere = np.full(window.shape, PlaceClass.CLEAR_GROUND)
    known = Known(truth, everywhere, np.ones(window.shape, bool))
    return Scene("mountain", crop, known, _GROSS, exact_model(crop.surface.grid, truth))


def _block() -> Block:
    camera = Camera(name="camera", width=SIZE[0], height=SIZE[1], c=C)
    photos = tuple(
        ExteriorOrientation(photo=name, centre=(BASE * (k - 1) / 2, 0.0, FLYING_HEIGHT), omega_phi_kappa=(0.0, 0.0, 0.0))
        for k, name in enumerate(_NAMES)
    )
    return Block(
        crs="EPSG:2100", cameras={"camera": camera}, of_photo=dict.fromkeys(_NAMES, "camera"), photos=photos, datum="control",
        sigma0_px=0.3, redundancy=100, iterations=1, ground_low=120.0, ground_high=420.0,
    )  # fmt: skip


def _tables(block: Block) -> dict:
    size = {"width": SIZE[0], "height": SIZE[1], "bands": 1, "dtype": "uint8", "levels": _LEVELS}
    photos = Photos(photos=tuple(Photo(name=name, path=name, camera="camera", **size) for name in _NAMES))
    x, y = (values.ravel() for values in np.meshgrid(np.arange(-300.0, 301.0, 60.0), np.arange(-300.0, 301.0, 60.0)))
    none, rays = np.zeros(x.size, np.float32), np.full(x.size, 3, np.int16)
    points = GroundPoints(np.arange(x.size), x, y, np.asarray(height(x, y)), none, none, none, rays, none)
    kinds = (np.int32, np.int32, np.float64, np.float64, np.float32, np.float32, np.float32, np.bool_)
    residuals = ImageResiduals(*(np.zeros(0, kind) for kind in kinds))
    return {BLOCK: block, PHOTOS: photos, GROUND_POINTS: points, IMAGE_RESIDUALS: residuals}


def _rasters(block: Block) -> list[tuple[RasterSpec, np.ndarray]]:
    rng = np.random.default_rng(8)
    paint = _paint(rng)
    found: list[tuple[RasterSpec, np.ndarray]] = []
    for name in _NAMES:
        pixels = _photograph(block_view(block, name), paint, rng)[..., None]
        for level in range(_LEVELS):
            found.append((RasterSpec(name=photo_raster(name, level), shape=pixels.shape, dtype="uint8", chunk=512), pixels))
            pixels = halved(pixels)
    return found


def _paint(rng: np.random.Generator) -> np.ndarray:
    side = int(2 * _HALF / _PAINTED)
    total = np.zeros((side, side), np.float32)
    for grain in (2, 4, 8, 24, 80):
        coarse = ndimage.gaussian_filter(rng.normal(0, 1, (side // grain + 3,) * 2), 1.0)
        total += 7.0 * (ndimage.zoom(coarse, grain, order=1)[:side, :side] / coarse.std()).astype(np.float32)
    return 120.0 + total


def _photograph(view: View, paint: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What a photograph shows, uint8."""
    n = view.numbers
    col, row = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    right, down = (col - n.col0) / n.c, (row - n.row0) / n.c
    z = np.full(col.shape, 250.0)
    for _ in range(40):  # slopes of the ground times those of the rays stay below 0.4
        z = height(n.xc + right * (n.zc - z), n.yc - down * (n.zc - z))
    x, y = n.xc + right * (n.zc - z), n.yc - down * (n.zc - z)
    grey = ndimage.map_coordinates(paint, [(_HALF - y) / _PAINTED, (x + _HALF) / _PAINTED], order=1, mode="nearest")
    return np.clip(np.rint(ndimage.gaussian_filter(grey, 0.6) + rng.normal(0.0, 2.0, grey.shape)), 1, 255).astype(np.uint8)
