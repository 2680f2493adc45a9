"""The camera constant by the focal length in the tags of a photograph, in pixels, and what contradicts it.

EXIF holds the marked focal length, not the one at the focused distance; a 35 mm equivalent is rounded to whole millimetres.
"""

import numpy as np

from orthomill.schemas.photo import Photo

SHARE_FROM_PIXEL, SHARE_FROM_35MM, SHARE_FROM_CUT = 0.02, 0.04, 0.1
"""Relative standard error of a camera constant from a focal length and a pixel size, from a 35 mm equivalent, and from one of a
frame that may have been cut from another"""
_BELIEVED = 0.25
"""A calibration whose constant differs by more than this part from what the focal length says is that of something else"""
_WIDTH_35MM, _DIAGONAL_35MM = 36.0, 43.27
"""mm: width and diagonal of a 35 mm film frame"""
_WHOLE, _FILM = 1.42, 1.6
"""Longer by shorter side up to which a frame is a whole sensor of 4:3 or 5:4, and up to which it is one of 3:2"""


def constant_by_focal_length(photo: Photo) -> tuple[float, float] | None:
    """Camera constant and its standard error, px, by focal length and pixel size, else by the 35 mm equivalent; None without."""
    return _by_pixel(photo) or _by_equivalent(photo)


def agrees_with_focal_length(c: float, photo: Photo) -> bool:
    """Whether a camera constant, px, can be that of the photograph by its focal length."""
    other = constant_by_focal_length(photo)
    return other is None or abs(c / other[0] - 1.0) < _BELIEVED


def _by_pixel(photo: Photo) -> tuple[float, float] | None:
    if not photo.focal_mm or not photo.pixel_um:
        return None
    c = 1000.0 * photo.focal_mm / photo.pixel_um * photo.zoom
    return c, SHARE_FROM_PIXEL * c


def _by_equivalent(photo: Photo) -> tuple[float, float] | None:
    """By the 35 mm equivalent: that of equal diagonals (CIPA DCG-001), of the whole frame, which a file of 16:9 may not be."""
    if not photo.focal_35mm:
        return None
    longer, shorter = max(photo.width, photo.height), min(photo.width, photo.height)
    if longer <= _WHOLE * shorter:
        c, share = photo.focal_35mm / _DIAGONAL_35MM * float(np.hypot(longer, shorter)), SHARE_FROM_35MM
    else:
        c, share = photo.focal_35mm / _WIDTH_35MM * longer, SHARE_FROM_35MM if longer <= _FILM * shorter else SHARE_FROM_CUT
    return c, share * c
