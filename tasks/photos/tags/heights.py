"""What the height in the tags is, and which of two that contradict each other is right.

EXIF's GPSAltitudeRef decides nothing: cameras write "above the sea" for ellipsoidal heights, for heights by the air pressure and
for heights above the place of take-off, and some write "below the sea" for all. What says more: the kind of fix, the type of the
height that DJI writes, and a second height in XMP.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.photo import HeightKind, Photo, PhotoRemark, PhotoRemarkCode, tag_text
from orthomill.tasks.geometry.coordinate_ranges import height_mistake
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.tags.fixes import fix_of
from orthomill.tasks.photos.tags.makers import maker_number, maker_text

_SAME, _ROUNDED = 1.0, 0.05
"""m: two tags give one height; they are equal but for their last digits"""
_DEEP = 20.0
"""m below the sea: few places are so low, and a receiver without corrections is not so far off"""
_FAR = 5.0
"""m: two tags give heights that are not the same one rounded, filtered or taken a moment later"""


@dataclass(frozen=True)
class TaggedHeight:
    """`value` m, as its `kind` says; `above_start`: m above the place of take-off; `remark`: a contradiction between tags."""

    value: float | None = None
    kind: HeightKind | None = None
    above_start: float | None = None
    remark: PhotoRemarkCode | None = None


def height_of(tags: Mapping[str, str]) -> TaggedHeight:
    """The height that is to be used, its kind, and what was wrong with the tags."""
    above_start = _possible(maker_number(tags, "RelativeAltitude"))
    value, remark = _chosen(exif.altitude(tags), _possible(maker_number(tags, "AbsoluteAltitude")), above_start)
    return TaggedHeight(value, None if value is None else _kind(tags, value, above_start), above_start, remark)


def _chosen(
    by_exif: float | None, by_maker: float | None, above_start: float | None
) -> tuple[float | None, PhotoRemarkCode | None]:
    """The height of EXIF unless the maker's own tags show that it is wrong."""
    if by_exif is None or by_maker is None:
        return (by_maker if by_exif is None else by_exif), None
    if by_exif * by_maker < 0 and abs(by_exif + by_maker) < _SAME:
        # The digits of EXIF: the maker's are rounded.
        return -by_exif, PhotoRemarkCode.BELOW_SEA
    if abs(by_exif - by_maker) < _FAR:
        return by_exif, None
    if above_start is not None and abs(by_exif - above_start) < _ROUNDED:
        return by_maker, PhotoRemarkCode.HEIGHT_ABOVE_START
    return by_exif, PhotoRemarkCode.HEIGHTS_DIFFER


def _kind(tags: Mapping[str, str], value: float, above_start: float | None) -> HeightKind | None:
    if fix_of(tags) in ("fixed", "float") or maker_text(tags, "AltitudeType").lower() == "rtkalt":
        return "ellipsoidal"
    if above_start is not None and abs(value - above_start) < _ROUNDED:
        return "relative"
    # EXIF 3.0: 2 and 3 are above and below the ellipsoid.
    if tag_text(tags, "GPSAltitudeRef").lower() in {"2", "3", "0x02", "0x03"}:
        return "ellipsoidal"
    barometric = maker_text(tags, "AltitudeType") or maker_number(tags, "AbsoluteAltitude") is not None
    return "barometric" if barometric else None


def _possible(height: float | None) -> float | None:
    return None if height is None or height == 0 or height_mistake(height) else height


def with_one_sign(photos: list[Photo]) -> tuple[list[Photo], list[PhotoRemark]]:
    """Photographs of which some are told to be as far below the sea as others are above it, all above it; and what is to be said.

    Where all are below it, nothing contradicts them, and it is only said.
    """
    known = np.array([np.nan if photo.altitude is None else photo.altitude for photo in photos])
    above, below = known[known > 0], known[known < 0]
    if len(below) and not len(above) and below.max() < -_DEEP:
        names = tuple(photo.name for photo in photos if photo.altitude is not None)
        return photos, [PhotoRemark(code=PhotoRemarkCode.ALL_BELOW_SEA, photos=names, words=(f"{np.median(below):.0f} m",))]
    if not len(below) or not len(above):
        return photos, []
    # A flight over the shore has heights of both signs as well, but none far from zero.
    spread = float(above.max() - above.min())
    mirrored = np.abs(-known - np.median(above)) <= max(spread, _DEEP)
    wrong = (known < 0) & mirrored & (float(np.median(above)) > 2 * max(spread, _DEEP))
    names = tuple(photo.name for photo, flipped in zip(photos, wrong, strict=True) if flipped)
    turned = [
        photo.model_copy(update={"altitude": -photo.altitude}) if flipped and photo.altitude else photo
        for photo, flipped in zip(photos, wrong, strict=True)
    ]
    return turned, [PhotoRemark(code=PhotoRemarkCode.BELOW_SEA, photos=names)] if names else []
