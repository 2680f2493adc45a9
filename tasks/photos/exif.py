"""EXIF tags, which GDAL returns as text, to numbers: "(46) (50) (33.38)" is a latitude, "(3.61)" a focal length.

A tag that is empty, zero where zero is impossible, or not a number counts as absent: cameras write all of these.
"""

import math
import re
from collections.abc import Mapping

from orthomill.schemas.photo import tag_text
from orthomill.tasks.geometry.coordinate_ranges import height_mistake

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
# EXIF 2.3 tag FocalPlaneResolutionUnit: inch and centimetre; 4 and 5 (millimetre, micrometre) are written by some cameras although
# the standard does not list them.
_FOCAL_PLANE_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_INCH = 2.0  # the unit that EXIF prescribes when the tag is absent


def numbers(tags: Mapping[str, str], name: str) -> list[float]:
    """All numbers of a tag; empty when it is absent or holds none."""
    return listed(tag_text(tags, name))


def listed(text: str) -> list[float]:
    """All numbers of a text."""
    found = [float(number) for number in _NUMBER.findall(text)]
    return found if all(map(math.isfinite, found)) else []  # damaged tags hold numbers such as 1e400


def positive(tags: Mapping[str, str], name: str) -> float | None:
    """The first number of a tag if it is greater than zero."""
    found = numbers(tags, name)
    return found[0] if found and found[0] > 0 else None


def longitude_latitude(tags: Mapping[str, str]) -> tuple[float, float] | None:
    """Degrees, east and north positive; None when absent, out of range, or exactly zero (a receiver without a fix)."""
    written = written_place(tags)
    return on_earth(*written) if written else None


def written_place(tags: Mapping[str, str]) -> tuple[float, float] | None:
    """Longitude and latitude as they are written, in range or not; None when one is absent."""
    longitude, latitude = _degrees(tags, "GPSLongitude", "W"), _degrees(tags, "GPSLatitude", "S")
    return None if longitude is None or latitude is None else (longitude, latitude)


def on_earth(longitude: float, latitude: float) -> tuple[float, float] | None:
    """The two degrees; None where they are out of range or exactly zero."""
    if abs(longitude) > 180 or abs(latitude) > 90 or longitude == latitude == 0:
        return None
    return longitude, latitude


def _degrees(tags: Mapping[str, str], name: str, negative: str) -> float | None:
    parts = numbers(tags, name)
    if not 1 <= len(parts) <= 3:
        return None
    value = sum(abs(part) / 60**power for power, part in enumerate(parts))
    return -value if tag_text(tags, f"{name}Ref").upper().startswith(negative) or parts[0] < 0 else value


def altitude(tags: Mapping[str, str]) -> float | None:
    """Metres above the reference of the receiver, negative below it (GPSAltitudeRef 1); None when absent or impossible.

    Exactly 0 is what receivers without a height write (0/0 among them, which GDAL shows as 0), as they do for the other two.
    """
    found = numbers(tags, "GPSAltitude")
    if not found or found[0] == 0:
        return None
    # GDAL prints the byte either as a number or in hexadecimal.
    below = tag_text(tags, "GPSAltitudeRef").lower() in {"1", "0x01"}
    value = -found[0] if below else found[0]
    return None if height_mistake(value) else value


def pixels_per_mm(tags: Mapping[str, str]) -> float | None:
    """The focal plane resolution of the image as the camera wrote it; None without these tags."""
    resolution = positive(tags, "FocalPlaneXResolution")
    unit = _FOCAL_PLANE_UNIT_MM.get(int((numbers(tags, "FocalPlaneResolutionUnit") or [_INCH])[0]))
    return None if resolution is None or unit is None else resolution / unit


def focal_plane_pixel_um(tags: Mapping[str, str], longer_side: int) -> float | None:
    """Side of a pixel from the focal plane resolution, micrometres; None without these tags.

    The resolution refers to the image as the camera wrote it; a file with fewer pixels (`longer_side`) was reduced afterwards, and
    its pixels are larger in proportion.
    """
    resolution = pixels_per_mm(tags)
    if resolution is None:
        return None
    written = max(positive(tags, "PixelXDimension") or 0.0, positive(tags, "PixelYDimension") or 0.0) or longer_side
    return 1000.0 / resolution * written / longer_side
