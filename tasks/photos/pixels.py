"""Pixels of a photograph: rotated upright strip by strip, halved level by level, and figures of its exposure."""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.photo import Soundness
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.masked_pixels import colours_of, picture_of, with_mask
from orthomill.tasks.imagery.pyramid import halved_window
from orthomill.tasks.imagery.radiometry import grey
from orthomill.tasks.imagery.upright import upright


class Exposure(BaseModel):
    """How a photograph is exposed, measured on its coarsest pyramid level; grey values are shares of the full range."""

    model_config = ConfigDict(frozen=True)

    photo: str
    mean: float
    contrast: float
    """standard deviation"""
    black: float
    white: float
    """shares of pixels at the ends of the range"""
    masked: float = 0.0
    """share of pixels that are no picture, which the other figures leave out"""


def picture_soundness(picture: Soundness) -> Soundness:
    """Whether the picture of a file is whole, as it was found: to be known before hours are spent on the other photographs."""
    return picture


def upright_strip(pixels: np.ndarray, orientation: int, mask: np.ndarray | None = None, mask_orientation: int = 1) -> np.ndarray:
    """Pixels (rows, cols, bands) as read from the file, upright; with a `mask` (rows, cols, bands), which has an orientation of its
    own, the last band of the result is full where there is picture."""
    strip = upright(pixels, orientation)
    return strip if mask is None else with_mask(strip, upright(mask, mask_orientation))


def level_tile(pixels: np.ndarray, window: Window) -> np.ndarray:
    """One tile `window` of a pyramid level from the level below (see `orthomill.tasks.imagery.pyramid.source_window`)."""
    return halved_window(pixels, window)


def exposure(overview: np.ndarray, photo: str) -> Exposure:
    """Exposure of a photograph from its coarsest level (rows, cols, bands)."""
    picture, full = picture_of(overview), _full_range(colours_of(overview))
    masked = float(1.0 - picture.mean())
    if masked == 1.0:
        return Exposure(photo=photo, mean=0.0, contrast=0.0, black=0.0, white=0.0, masked=masked)
    values = grey(overview)[picture] / full
    # One grey level of 8 bits from the ends counts as clipped: averaging down the pyramid rarely leaves 0 or 255 exactly.
    return Exposure(
        photo=photo,
        mean=float(values.mean()),
        contrast=float(values.std()),
        black=float((values <= 1 / 255).mean()),
        white=float((values >= 254 / 255).mean()),
        masked=masked,
    )


def _full_range(overview: np.ndarray) -> float:
    """The greatest grey value that the camera can write: 255, or that of 10, 12, 14 or 16 bits that hold the photograph."""
    if overview.dtype == np.uint8:
        return 255.0
    return float(next(full for full in (1023, 4095, 16383, 65535) if overview.max() <= full))
