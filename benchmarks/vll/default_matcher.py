"""Heights of places by the default method, from the photographs of a scene alone: the stages as a project runs them."""

import numpy as np

from benchmarks.vll.line_locus_scene import LocusPair, height
from orthomill.schemas.observations import GROUND_POINTS, IMAGE_RESIDUALS, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.project import PhotoList, Project
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.surface import HEIGHT, MEASURED, PROVENANCE, SURFACE
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.imagery.pyramid import halved
from orthomill.temporary_run import GivenResults, temporary_run

_LEVELS, _TILE = 4, 512
_CELL = 1.0
"""m: of the surface that is looked up"""


def default_heights(pair: LocusPair, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Measured heights (rows, cols) at X (cols,) and Y (rows,), NaN where the surface is an estimate."""
    given = GivenResults.of(_tables(pair, x, y), _rasters(pair))
    project = Project(project="line_locus", crs=pair.block.crs, photographs=PhotoList(kind="list", paths=("left", "right")))
    with temporary_run(project, (given, EpipolarStage(), DensificationStage(cell=_CELL))) as store:
        grid = store.table(SURFACE).grid
        whole = store.spec(HEIGHT).full
        heights, codes = store.read(HEIGHT, whole), store.read(PROVENANCE, whole)
    col, row = grid.pixel(*np.meshgrid(x, y))
    at = np.rint(row).astype(int), np.rint(col).astype(int)
    # A cell is not the node itself: the ground between their places is taken off.
    centres = grid.centres(whole)
    moved = height(*np.meshgrid(x, y)) - height(centres[0][at[1]], centres[1][at[0]])
    return np.where(np.isin(codes[at], MEASURED), heights[at] + moved, np.nan)


def _tables(pair: LocusPair, x: np.ndarray, y: np.ndarray) -> dict:
    camera = next(iter(pair.block.cameras.values()))
    size = {"width": camera.width, "height": camera.height, "bands": 1, "dtype": "uint8", "levels": _LEVELS}
    photos = Photos(photos=tuple(Photo(name=name, path=name, camera=name, **size) for name in ("left", "right")))
    ground_x, ground_y = (values.ravel() for values in np.meshgrid(x[::6], y[::6]))
    none, rays = np.zeros(ground_x.size, np.float32), np.full(ground_x.size, 2, np.int16)
    points = GroundPoints(np.arange(ground_x.size), ground_x, ground_y, height(ground_x, ground_y), none, none, none, rays, none)
    empty = (
        np.zeros(0, kind) for kind in (np.int32, np.int32, np.float64, np.float64, np.float32, np.float32, np.float32, np.bool_)
    )
    return {BLOCK: pair.block, PHOTOS: photos, GROUND_POINTS: points, IMAGE_RESIDUALS: ImageResiduals(*empty)}


def _rasters(pair: LocusPair) -> list[tuple[RasterSpec, np.ndarray]]:
    found: list[tuple[RasterSpec, np.ndarray]] = []
    for name, image in zip(("left", "right"), pair.images, strict=True):
        pixels = image[..., None]
        for level in range(_LEVELS):
            found.append((RasterSpec(name=photo_raster(name, level), shape=pixels.shape, dtype="uint8", chunk=_TILE), pixels))
            pixels = halved(pixels)
    return found
