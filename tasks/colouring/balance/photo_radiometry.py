"""The radiometry of the block: what makes the grey values of its photographs comparable, and how it is applied to them.

The grey value of photo i at a point of ground brightness G is  g = gain_i (1 + v1 r^2 + v2 r^4) G + offset_i,  with r from the
photo's middle in half diagonals; or a curve for each channel.
"""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.kernels.kernel_compilation import njit


class GreyCurve(BaseModel):
    """Grey values that become others: linear between those given, at the same distance beyond them."""

    model_config = ConfigDict(frozen=True)

    start: tuple[float, ...]
    end: tuple[float, ...]


class PhotoRadiometry(BaseModel):
    """Correction of the grey values of one photograph to those of the block.

    (g - offset) / (gain (1 + v1 r^2 + v2 r^4)), or a curve for each channel.
    """

    model_config = ConfigDict(frozen=True)

    photo: str
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    v1: tuple[float, float, float] = (0.0, 0.0, 0.0)
    v2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    curves: tuple[GreyCurve, ...] = ()
    samples: int = 0


class Radiometry(BaseModel):
    """The balance of all photographs, and the range of grey values that is stretched to 0 to 255."""

    model_config = ConfigDict(frozen=True)

    photos: tuple[PhotoRadiometry, ...]
    black: float = 0.0
    white: float = 255.0
    samples: int = 0
    points: int = 0
    difference_before: float | None = None
    difference_after: float | None = None
    """mean absolute difference of two photos at the same sample, grey levels"""
    difference_median_after: float | None = None

    def of(self, name: str) -> PhotoRadiometry:
        """The correction of one photograph."""
        return next(photo for photo in self.photos if photo.photo == name)


def corrected(grey: np.ndarray, r2: np.ndarray, photo: PhotoRadiometry) -> np.ndarray:
    """Grey values (..., bands) of a photo at `r2` (...) corrected to the block's radiometry; bands 1 or 3. float32."""
    # float32 throughout: every pixel of every photograph passes here, and 24 bits are ample for grey values.
    out = np.ascontiguousarray(grey, np.float32).reshape(-1, grey.shape[-1]).copy()
    if photo.curves:
        for band in range(out.shape[1]):
            out[:, band] = _along(out[:, band], photo.curves[band])
        return out.reshape(grey.shape)
    correct(out, np.ascontiguousarray(r2, np.float32).ravel(), correction_terms(photo))
    return out.reshape(grey.shape)


def in_block(grey: np.ndarray, r2: np.ndarray, name: str, radiometry: Radiometry) -> np.ndarray:
    """Grey values (..., bands) of the photograph `name` at `r2` (...) as those of other photographs, 0 to 255; float32."""
    return corrected(grey, r2, radiometry.of(name)) * (255.0 / radiometry.white)


def correction_terms(photo: PhotoRadiometry, scale: float = 1.0) -> np.ndarray:
    """What `correct` needs, float32 (5, 3): gain, offset, v1, v2 by channel, and a factor on the result."""
    return np.array([photo.gain, photo.offset, photo.v1, photo.v2, (scale,) * 3], np.float32)


def _along(grey: np.ndarray, curve: GreyCurve) -> np.ndarray:
    """Grey values (N,) after a curve."""
    inside = np.clip(grey, curve.start[0], curve.start[-1])
    return np.asarray(np.interp(inside, curve.start, curve.end) + (grey - inside), np.float32)


@njit(error_model="numpy")
def correct(grey, r2, terms):
    """Corrects grey (N, bands) in place; terms: see `correction_terms`."""
    if grey.shape[1] == 3:
        _correct_bands(grey, r2, terms, 3)
    else:
        _correct_bands(grey, r2, terms, grey.shape[1])


@njit(error_model="numpy", inline="always")
def _correct_bands(grey, r2, terms, bands):
    """As `correct`; `bands` is written out where it is called, so that the compiler unrolls the loop over them."""
    one = np.float32(1.0)
    for i in range(r2.size):
        for band in range(bands):
            falloff = one + r2[i] * (terms[2, band] + r2[i] * terms[3, band])
            grey[i, band] = (grey[i, band] - terms[1, band]) / (terms[0, band] * falloff) * terms[4, band]
