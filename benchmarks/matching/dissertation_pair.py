"""The synthetic stereopair of the published matching experiment: both photographs, rendered window by window from any texture.

Strategy. Every pixel's ray is intersected with the surface exactly and the texture, an orthophoto, is read there by bicubic
interpolation. A pixel's value depends on its own position in the photograph only (Newton's method restarts at fixed columns, noise
is hashed from row and column), so windows fit together without a seam. Ground beyond the texture is 0, "no data"; grey values are 1
to 255.

The dissertation's own texture is not public. The shipped mosaic is three times too coarse to be used at its true size; it is given
the pixel of the experiment instead and continued by mirroring, three times along each axis, which just covers the ground of the
original. Copies are hundreds of metres apart, far beyond any search range. Mirroring leaves a crease but no step.

Source: Skarlatos (sources/matching.md#synthetic-pair); sources/measured.md (with noise).
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numba import njit

from benchmarks.matching.dissertation_surface import (
    CORNER,
    FLYING_HEIGHT,
    PIXEL,
    SIDE,
    STATION_X,
    STATION_Y,
    C,
    PublishedPhoto,
    grid_points,
    projected,
    ray_height,
    true_matches,
)
from benchmarks.measured_run import ROOT
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.bicubic import bicubic_at
from orthomill.tasks.simulation.scene.hash_noise import normal_of

SHIPPED_TEXTURE = ROOT / "tasks" / "simulation" / "textures" / "village.jpg"
TEXTURE_WEST, TEXTURE_NORTH, TEXTURE_CELL = 9412.94, 11286.09, 0.169
"""m: upper-left corner of the texture, and its pixel"""
TEXTURE_SHAPE = (15220, 13480)
"""rows and columns of the texture that the experiment's ground asks for"""
_BLOCK = 16  # columns after which Newton's method restarts: a start from the neighbour saves iterations, but must not travel far
_SEED = 2009
_LATTICE = 16  # px between the true matches from which a window of the right photograph follows


@dataclass(frozen=True, eq=False)
class GroundTexture:
    """Grey values uint8 (rows, cols) of an orthophoto with the experiment's georeference, and a name for it."""

    pixels: np.ndarray
    name: str


@dataclass(frozen=True)
class PairRadiometry:
    """Radiometry of a version of the pair: noise on both photographs, gain and offset of the right one. Default: rounding only."""

    noise: float = 0.0
    """standard deviation, grey values"""
    gain: float = 1.0
    offset: float = 0.0


CLEAN = PairRadiometry()
NOISY = PairRadiometry(noise=2.0, gain=0.9, offset=10.0)
"""the second version of the measured experiments (sources/measured.md)"""


def ground_texture(path: Path | None = None) -> GroundTexture:
    """Reads a texture, by default the shipped one; one too small for the ground of the experiment is continued by mirroring.

    Raises ResourceError when the file is no image.
    """
    path = SHIPPED_TEXTURE if path is None else Path(path)
    pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
    if pixels is None:
        raise ResourceError(f"{path} is needed as ground texture but cannot be read as an image; give a JPEG, PNG or TIFF.")
    return GroundTexture(mirrored(pixels, TEXTURE_SHAPE), path.stem)


def mirrored(pixels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The pixels (rows, cols) cut or continued by mirroring (edge pixels doubled) to `shape`."""
    rows, cols = (_mirrored_index(wanted, have) for wanted, have in zip(shape, pixels.shape, strict=True))
    return pixels[np.ix_(rows, cols)]


def _mirrored_index(wanted: int, have: int) -> np.ndarray:
    place = np.arange(wanted) % (2 * have)
    return np.where(place < have, place, 2 * have - 1 - place)


def rendered(texture: GroundTexture, photo: PublishedPhoto, window: Window, radiometry: PairRadiometry = CLEAN) -> np.ndarray:
    """A window of a photograph, uint8 (rows, cols); 0 where the texture ends and outside the photograph."""
    out = np.zeros(window.shape, np.uint8)
    gain, offset = (radiometry.gain, radiometry.offset) if photo is PublishedPhoto.RIGHT else (1.0, 0.0)
    _render(texture.pixels, window.row, window.col, STATION_X[photo], (gain, offset, radiometry.noise), _SEED + photo, out)
    return out


@njit(cache=True)
def _render(texture, first_row, first_col, station_x, radiometry, seed, out):
    gain, offset, noise = radiometry
    # From the restart before the window on: the start of every pixel is that of the whole photograph, to the last bit.
    begin = max(first_col, 0) // _BLOCK * _BLOCK
    for r in range(max(-first_row, 0), min(out.shape[0], SIDE - first_row)):
        y = (CORNER - (first_row + r + 0.5) * PIXEL) / C
        z = 100.0
        for col in range(begin, min(first_col + out.shape[1], SIDE)):
            x = ((col + 0.5) * PIXEL - CORNER) / C
            z = ray_height(station_x, x, y, 100.0 if col % _BLOCK == 0 else z)
            if col < first_col:
                continue
            u = (station_x + x * (FLYING_HEIGHT - z) - TEXTURE_WEST) / TEXTURE_CELL - 0.5
            v = (TEXTURE_NORTH - STATION_Y - y * (FLYING_HEIGHT - z)) / TEXTURE_CELL - 0.5
            if 1.0 <= u < texture.shape[1] - 2 and 1.0 <= v < texture.shape[0] - 2:
                grey = gain * bicubic_at(texture, v, u) + offset + noise * normal_of(seed, first_row + r, col)
                out[r, col - first_col] = np.uint8(min(max(np.floor(grey + 0.5), 1.0), 255.0))


@dataclass(frozen=True, eq=False)
class PairCrop:
    """A part of the pair: two images and where their upper-left pixels lie in the photographs, (col, row)."""

    left: np.ndarray
    right: np.ndarray
    left_origin: tuple[int, int]
    right_origin: tuple[int, int]


def pair_crop(texture: GroundTexture, left: Window, margin: int, radiometry: PairRadiometry = CLEAN) -> PairCrop:
    """A window of the left photograph, and the window of the right one that shows all of it and `margin` px around it."""
    from_right = right_window(left, margin)
    return PairCrop(
        rendered(texture, PublishedPhoto.LEFT, left, radiometry),
        rendered(texture, PublishedPhoto.RIGHT, from_right, radiometry),
        (left.col, left.row),
        (from_right.col, from_right.row),
    )


def right_window(left: Window, margin: int) -> Window:
    """The window of the right photograph that shows the ground of a window of the left one, grown by `margin` px.

    Found from true matches `_LATTICE` px apart; between them the parallax deviates by less than a pixel.
    """
    rows = np.append(np.arange(left.row, left.row + left.height, _LATTICE), left.row + left.height)
    cols = np.append(np.arange(left.col, left.col + left.width, _LATTICE), left.col + left.width)
    lattice = np.column_stack([part.ravel() for part in np.meshgrid(cols, rows)])
    right = true_matches(lattice)
    first = [int(value) for value in np.floor(right.min(axis=0)) - 1]
    last = [int(value) for value in np.ceil(right.max(axis=0)) + 1]
    return Window(first[1], first[0], last[1] - first[1], last[0] - first[0]).grown(margin).clipped((SIDE, SIDE))


def check_points(half_frame: float, margin: float) -> np.ndarray:
    """Integer pixels (N, 2) of the left photograph nearest to the 10 m grid points that both show within `half_frame` mm.

    Points nearer than `margin` px to the end of the texture are left out.
    """
    ground = grid_points(half_frame)
    reach = margin * PIXEL / C * FLYING_HEIGHT
    south, east = TEXTURE_NORTH - TEXTURE_SHAPE[0] * TEXTURE_CELL, TEXTURE_WEST + TEXTURE_SHAPE[1] * TEXTURE_CELL
    inside = (
        (ground[:, 0] > TEXTURE_WEST + reach)
        & (ground[:, 0] < east - reach)
        & (ground[:, 1] > south + reach)
        & (ground[:, 1] < TEXTURE_NORTH - reach)
    )
    return np.floor(projected(ground[inside], PublishedPhoto.LEFT) + 0.5)
