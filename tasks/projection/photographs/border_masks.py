"""Black borders of photographs, found: what undistortion or a rotation leaves beside the picture is no colour of the object.

Pixels without any light that hang together with the frame of the photograph are its border, from a number of pixels on. A black
background has noise and is none, nor is what is dark inside the picture. Next to the border JPEG makes ripples, which are nearly
black, and the interpolation mixes it with its neighbours: both are left out with it.
"""

from typing import NamedTuple

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.tasks.imagery.masked_pixels import colours_of, picture_of

BLACK, RIPPLE = 0.004, 0.04
"""shares of the range up to which a grey value is black, and up to which it is a ripple of JPEG"""
REACH = 8
"""px from the border up to which ripples reach: a block of JPEG"""
LEAST = 0.0005
"""share of the photograph that a border has at least: a dark bush at the frame is none"""
MARGIN = 3
"""px around the border that are left out with it: the interpolation between pixels reaches two"""


class BorderFacts(BaseModel):
    """The share of a photograph that is black border."""

    model_config = ConfigDict(frozen=True)

    share: float


class BorderMask(NamedTuple):
    """uint8 (rows, cols, 1), 0 where a photograph is not to be used, and how much of it that is."""

    mask: np.ndarray
    facts: BorderFacts


def border_mask(pixels: np.ndarray) -> BorderMask:
    """The mask of a photograph (rows, cols, bands); what its file masks belongs to the border wherever it lies."""
    lightest, full = colours_of(pixels).max(axis=2), float(np.iinfo(pixels.dtype).max)
    black = (lightest <= BLACK * full).astype(np.uint8)
    # One component with all that lies outside of the photograph.
    framed = cv2.copyMakeBorder(black, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    _, labels = cv2.connectedComponents(framed, connectivity=4)
    border = (labels == labels[0, 0])[1:-1, 1:-1]
    # Specks at the frame are no border: each piece counts by itself.
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(border.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] >= LEAST * border.size
    large[0] = False
    border = large[pieces] if count > 1 else np.zeros_like(border)
    border |= ~picture_of(pixels)
    rippled = border | ((_grown(border, REACH) > 0) & (lightest <= RIPPLE * full))
    grown = _grown(rippled, MARGIN) if border.any() else rippled
    return BorderMask(np.where(grown > 0, 0, 255).astype(np.uint8)[..., None], BorderFacts(share=float(border.mean())))


def _grown(border: np.ndarray, by: int) -> np.ndarray:
    return np.asarray(cv2.dilate(border.astype(np.uint8), np.ones((2 * by + 1, 2 * by + 1), np.uint8)))
