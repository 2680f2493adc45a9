"""Photographs of which parts are no picture: behind grey or colours their rasters have one more band, full where there is picture.

On coarser levels of the pyramid this band is full where nothing else was averaged into a pixel. Whoever interpolates takes NaN
where there is no picture (`picture_or_nan`), and gets NaN for every place whose neighbours are not all picture.
"""

import numpy as np

_MASKED = (2, 4)
"""bands of a raster with a mask: grey or three colours before it"""


def is_masked(pixels: np.ndarray) -> bool:
    """Whether pixels (rows, cols) or (rows, cols, bands) have a band that tells where there is picture."""
    return pixels.ndim == 3 and pixels.shape[2] in _MASKED


def picture_of(pixels: np.ndarray) -> np.ndarray:
    """bool (rows, cols): where there is picture."""
    if not is_masked(pixels):
        return np.ones(pixels.shape[:2], bool)
    return np.asarray(pixels[..., -1] == np.iinfo(pixels.dtype).max)


def colours_of(pixels: np.ndarray) -> np.ndarray:
    """The pixels without their mask: (rows, cols) or (rows, cols, 1 or 3)."""
    return pixels[..., :-1] if is_masked(pixels) else pixels


def with_mask(pixels: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Pixels (rows, cols, bands) with a last band: full where they are picture and the mask (rows, cols, bands) is not black.

    Grey of less than an eighth of the range counts as black: JPEG leaves ripples beside the edges of masks.
    """
    light = colours_of(mask).max(axis=2) >= np.iinfo(mask.dtype).max // 8
    full = np.iinfo(pixels.dtype).max
    picture = np.where(light & picture_of(pixels) & picture_of(mask), full, 0).astype(pixels.dtype)
    return np.concatenate([colours_of(pixels), picture[..., None]], axis=2)


def picture_or_nan(pixels: np.ndarray) -> np.ndarray:
    """The colours as they are, or as float32 with NaN where there is no picture."""
    if not is_masked(pixels):
        return pixels
    picture, colours = picture_of(pixels), np.ascontiguousarray(colours_of(pixels))
    if picture.all():
        return colours
    gaps = colours.astype(np.float32)
    gaps[~picture] = np.nan
    return gaps
