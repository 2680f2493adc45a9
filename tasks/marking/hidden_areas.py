"""Hidden areas of a photograph as its mask, in the frame of its file, as other programs write masks."""

from collections.abc import Iterable

import cv2
import numpy as np

from orthomill.schemas.marks import HiddenArea
from orthomill.schemas.photo import Photo
from orthomill.tasks.imagery.upright import from_upright


def hidden_mask(photo: Photo, areas: Iterable[HiddenArea], own: np.ndarray | None = None) -> np.ndarray:
    """uint8 (rows, cols) of the file of a photograph: 0 in the `areas`, and where its `own` mask (rows, cols, bands) is black."""
    shown = np.full((photo.height, photo.width, 1), 255, np.uint8)
    for area in areas:
        cv2.fillPoly(shown[..., 0], [np.rint(np.array(area.corners)).astype(np.int32)], 0)
    mask = from_upright(shown, photo.exif_orientation)[..., 0]
    if own is None:
        return mask
    light = own.max(axis=2, keepdims=True)
    return np.minimum(mask, (from_upright(light, photo.exif_orientation) if photo.mask_upright else light)[..., 0])
