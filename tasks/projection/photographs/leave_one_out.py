"""Every photograph against what the others say of it: the block's own proof, without any reference.

A photograph is made again from all others, at a level of its pyramid, and compared where the others cover it: PSNR, SSIM (Wang et
al. 2004) and gradient energy, the sum of squared differences between neighbours, as a part of the photograph's own: blending blurs
where mesh and orientation disagree. The same from the nearest photograph alone is what programs with one photograph per face give.

Source: Petsa et al. 2007, Fig. 35 (sources/blending.md#data, A-22).
"""

from typing import NamedTuple

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry, in_block
from orthomill.tasks.imagery.masked_pixels import colours_of, picture_of

RIM = 3
"""px next to what is not covered that take no part: their neighbours are not known"""
_BLUR, _STABLE = (11, 1.5), ((0.01 * 255) ** 2, (0.03 * 255) ** 2)


class PictureLikeness(BaseModel):
    """How like a picture is to a photograph."""

    model_config = ConfigDict(frozen=True)

    psnr: float
    """dB"""
    ssim: float
    gradient: float
    """gradient energy over that of the photograph"""


class LeftOutPhotograph(BaseModel):
    """A photograph made again from the others."""

    model_config = ConfigDict(frozen=True)

    photo: str
    covered: float
    """part of its pixels that the others cover"""
    blended: PictureLikeness | None = None
    nearest: PictureLikeness | None = None
    difference: float | None = None
    """mean absolute difference, grey levels"""
    """None: too little is covered"""


class ComparedPhotograph(NamedTuple):
    """The comparison, and the mean absolute difference over the channels, uint8 (rows, cols), 0 where nothing is compared."""

    result: LeftOutPhotograph
    difference: np.ndarray


def compare_left_out(
    blended: np.ndarray, nearest: np.ndarray, pixels: np.ndarray, radiometry: Radiometry, name: str
) -> ComparedPhotograph:
    """The photograph `name`, its pixels (rows, cols, bands) at the level of the two pictures (rows, cols, 4)."""
    rows, cols = pixels.shape[:2]
    half = 0.5 * np.array([rows - 1.0, cols - 1.0])
    row, col = np.indices((rows, cols))
    r2 = ((row - half[0]) ** 2 + (col - half[1]) ** 2) / (half**2).sum()
    own = in_block(colours_of(pixels), r2.astype(np.float32), name, radiometry)
    own = np.clip(np.broadcast_to(own, (rows, cols, 3)), 0, 255).astype(np.float32)
    known = (blended[..., 3] > 0) & (nearest[..., 3] > 0) & picture_of(pixels)
    core = cv2.erode(known.astype(np.uint8), np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8)) > 0
    apart = np.abs(blended[..., :3] - own).mean(axis=2)
    difference = np.where(known, np.clip(np.round(apart), 0, 255), 0).astype(np.uint8)
    if core.sum() < 100:
        return ComparedPhotograph(LeftOutPhotograph(photo=name, covered=float(known.mean())), difference)
    result = LeftOutPhotograph(
        photo=name,
        covered=float(known.mean()),
        blended=likeness(blended[..., :3], own, core),
        nearest=likeness(nearest[..., :3], own, core),
        difference=float(apart[core].mean()),
    )
    return ComparedPhotograph(result, difference)


def likeness(picture: np.ndarray, own: np.ndarray, core: np.ndarray) -> PictureLikeness:
    """Of a picture to a photograph, both (rows, cols, 3) grey levels, at the pixels `core` (rows, cols)."""
    picture = picture.astype(np.float32)
    square = float(((picture - own)[core] ** 2).mean())
    one, two = picture.mean(axis=2), own.mean(axis=2)
    return PictureLikeness(
        psnr=float(10.0 * np.log10(255.0**2 / max(square, 1e-6))),
        ssim=float(structural_similarity(one, two)[core].mean()),
        gradient=gradient_energy(one, core) / max(gradient_energy(two, core), 1e-12),
    )


def structural_similarity(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """SSIM (rows, cols) of two grey pictures of 0 to 255, with the published Gaussian window."""

    def mean(values: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(values.astype(np.float64), (_BLUR[0], _BLUR[0]), _BLUR[1])

    a, b = mean(one), mean(two)
    var_a, var_b = mean(one.astype(np.float64) ** 2) - a**2, mean(two.astype(np.float64) ** 2) - b**2
    both = mean(one.astype(np.float64) * two) - a * b
    return (2 * a * b + _STABLE[0]) * (2 * both + _STABLE[1]) / ((a**2 + b**2 + _STABLE[0]) * (var_a + var_b + _STABLE[1]))


def gradient_energy(grey: np.ndarray, core: np.ndarray) -> float:
    """Mean squared difference between neighbouring pixels, in both directions, at the pixels `core`."""
    right, down = np.diff(grey.astype(np.float64), axis=1), np.diff(grey.astype(np.float64), axis=0)
    return float((right[core[:, 1:]] ** 2).mean() + (down[core[1:]] ** 2).mean())
