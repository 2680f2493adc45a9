"""Where an orthoimage shows a surveyed point: the patches of the photographs in which it was marked, matched by least squares.

Each patch is cut about the mark and resampled to the grid of the orthoimage with the orientation of its photograph, so that both
differ by a shift and by exposure. The block's errors move the whole patch and not the mark in it: the place that is found is that
of the mark, as if somebody had measured it in the orthoimage.
"""

import math
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.accuracy.point_tests import PlaceTest
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.accuracy.points.agreeing_places import agreed_place
from orthomill.tasks.geometry.view import View
from orthomill.tasks.imagery.pyramid import full_to_level
from orthomill.tasks.imagery.radiometry import grey
from orthomill.tasks.imagery.resampling import sample_cubic
from orthomill.tasks.matching.least_squares.matching import match_points
from orthomill.tasks.matching.least_squares.model import LeastSquaresMatching

Triple = tuple[float, float, float]
HALF = 10
"""half side of the window that is compared, pixels of the orthoimage"""
SEARCH = 20
"""how far from the surveyed place a point is looked for, pixels of the orthoimage"""
_MARGIN = 4
_ALIKE = 0.6
"""correlation from which a place may be the point's"""
_VAGUE = 0.25
"""pixels of the orthoimage: a match with a larger standard error is one of other ground, as beside walls, whose patches lean"""


@dataclass(frozen=True)
class OrthoPixels:
    """Pixels of an orthoimage around a point: (rows, cols, bands), at `window` of `grid`."""

    grid: MapGrid
    window: Window
    pixels: np.ndarray


@dataclass(frozen=True)
class MarkedPatch:
    """A patch of a photograph about the mark of a point."""

    view: View
    mark: tuple[float, float, float]
    """(col, row, sigma), px of the full photograph"""
    level: int
    """of the photograph's pyramid that the patch is cut from"""
    window: Window
    """of that level"""
    pixels: np.ndarray
    """(rows, cols, bands)"""


@dataclass(frozen=True)
class GroundPlane:
    """The ground near a point: X, Y, Z m, and the rises to the east and to the north."""

    place: tuple[float, float, float]
    east: float = 0.0
    north: float = 0.0


def pixels_around(grid: MapGrid, x: float, y: float) -> Window:
    """The window (not clipped) of the orthoimage that the search of a point at x, y (m) reads."""
    col, row = grid.pixel(x, y)
    reach = HALF + SEARCH + _MARGIN
    return Window(round(float(row)) - reach, round(float(col)) - reach, 2 * reach + 1, 2 * reach + 1)


def patch_window(
    view: View, mark: tuple[float, float, float], place: tuple[float, float, float], cell: float, level: int
) -> Window:
    """The window (not clipped) of a level of a photograph that holds the patch about a mark."""
    away = np.linalg.norm(np.array(place) - view.centre)
    # Oblique patches are longer in the photograph; twice the nominal size holds tilts up to 60 degrees.
    reach = int(2 * np.sqrt(2) * (HALF + _MARGIN) * cell * view.camera.c / away / 2**level) + _MARGIN
    col, row = full_to_level(np.array([mark[:2]]), level)[0]
    return Window(round(float(row)) - reach, round(float(col)) - reach, 2 * reach + 1, 2 * reach + 1)


def level_for(view: View, place: Triple, cell: float, levels: int) -> int:
    """The level of a photograph's pyramid whose pixels on the ground are nearest to those of the orthoimage, not larger."""
    pixel = np.linalg.norm(np.array(place) - view.centre) / view.camera.c
    return min(max(math.floor(math.log2(max(cell / float(pixel), 1e-9)) + 0.25), 0), levels - 1)


def place_in_orthoimage(ortho: OrthoPixels, patches: tuple[MarkedPatch, ...], ground: GroundPlane) -> PlaceTest:
    """Where `ortho` shows the point that is marked in `patches`; `ground`: the surveyed place and the plane around it."""
    if ortho.window.empty or not ortho.pixels.size:
        return PlaceTest(reason="outside of the orthoimage")
    if not patches:
        return PlaceTest(reason="marked in no photograph")
    drawn = [(patch, _drawn(patch, ortho.grid, ground)) for patch in patches]
    whole = [(patch, pixels) for patch, pixels in drawn if np.isfinite(_compared(pixels)).all()]
    if not whole:
        return PlaceTest(reason="marked only at the border of photographs")
    found = [(_found(ortho, pixels), patch) for patch, pixels in whole]
    known = [(place, _precision(sigma, patch, ground)) for (place, sigma), patch in found if place is not None]
    if not known:
        return PlaceTest(reason=f"not found within {SEARCH} pixels: no patch of a photograph resembles the orthoimage here")
    return agreed_place(np.array([k[0] for k in known]), np.array([k[1] for k in known]), len(whole))


def _precision(sigma: np.ndarray, patch: MarkedPatch, ground: GroundPlane) -> np.ndarray:
    """Variances (2,) m2 of a place: those of its matching, and of the mark on the ground."""
    pixel = np.linalg.norm(np.array(ground.place) - patch.view.centre) / patch.view.camera.c
    return sigma**2 + (patch.mark[2] * pixel) ** 2


def _drawn(patch: MarkedPatch, grid: MapGrid, ground: GroundPlane) -> np.ndarray:
    """The patch on pixels of the orthoimage, the mark in its middle: (side, side) float32, NaN beyond the photograph."""
    half = HALF + _MARGIN
    steps = np.arange(-half, half + 1) * grid.cell
    east, south = np.meshgrid(steps, steps)
    x, y, z = ground.place
    points = np.column_stack([(x + east).ravel(), (y - south).ravel(), (z + ground.east * east - ground.north * south).ravel()])
    pixels = patch.view.project(points)
    pixels += np.array(patch.mark[:2]) - pixels[len(pixels) // 2]
    own = full_to_level(pixels, patch.level) - (patch.window.col, patch.window.row)
    image = grey(patch.pixels)
    inside = ((own >= 0) & (own <= np.array(image.shape[::-1]) - 1)).all(axis=1)
    values = np.where(inside, sample_cubic(image, np.where(np.isfinite(own), own, -1.0)), np.nan)
    return values.astype(np.float32).reshape(east.shape)


def _found(ortho: OrthoPixels, patch: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """Place (2,) m of the middle of a patch in the orthoimage, None where it is not found, and its standard errors (2,) m."""
    image = grey(ortho.pixels)
    start = _most_alike(image, patch)
    none = None, np.full(2, np.nan)
    if start is None:
        return none
    settings = LeastSquaresMatching(window=2 * HALF + 1, geometry="shift", max_shift=2.0, min_correlation=_ALIKE)
    middle = np.array([[patch.shape[1] // 2, patch.shape[0] // 2]], np.float64)
    match = match_points(patch, image, middle, start[None], settings)
    if match.outcome[0] != Outcome.CONVERGED:
        return none
    sigma = np.sqrt(np.diagonal(match.covariance[0]))
    if not (sigma <= _VAGUE).all():
        return none
    col, row = match.col[0] + ortho.window.col, match.row[0] + ortho.window.row
    grid = ortho.grid
    place = np.array([grid.west + (col + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell])
    return place, grid.cell * sigma


def _compared(patch: np.ndarray) -> np.ndarray:
    """The window of a drawn patch that is compared."""
    middle = patch.shape[0] // 2
    return patch[middle - HALF : middle + HALF + 1, middle - HALF : middle + HALF + 1]


def _most_alike(image: np.ndarray, patch: np.ndarray) -> np.ndarray | None:
    """(col, row) in the image where the middle of a patch correlates best; None where nothing is alike."""
    import cv2

    window = _compared(patch)
    if min(image.shape) < window.shape[0]:
        return None
    known = np.isfinite(image)
    if not known.any():
        return None
    score = cv2.matchTemplate(np.where(known, image, np.float32(np.nanmean(image))), window, cv2.TM_CCOEFF_NORMED)
    row, col = np.unravel_index(int(np.nanargmax(np.where(np.isfinite(score), score, -1))), score.shape)
    if score[row, col] < _ALIKE - 0.2:
        return None
    return np.array([col + HALF, row + HALF], np.float64)
