"""The few EXIF tags that a starting workflow uses: camera, focal length and position, from a header's tags as text."""

import re

from orthomill.schemas.photo import Header

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def longitude_latitude(tags: dict[str, str]) -> tuple[float, float] | None:
    """Longitude and latitude in degrees from the GPS tags, east and north positive; None where they are absent or unset (0, 0)."""
    # Receivers without a fix write zeros; nobody photographs the Gulf of Guinea at exactly (0, 0).
    longitude = _degrees(tags.get("GPSLongitude", ""), tags.get("GPSLongitudeRef", ""))
    latitude = _degrees(tags.get("GPSLatitude", ""), tags.get("GPSLatitudeRef", ""))
    if longitude is None or latitude is None or (longitude, latitude) == (0.0, 0.0) or abs(longitude) > 180 or abs(latitude) > 90:
        return None
    return longitude, latitude


def _degrees(text: str, reference: str) -> float | None:
    """Degrees from "(46) (50) (33.3855)" and N, S, E or W; without a letter, north or east is assumed."""
    # GDAL writes rationals in parentheses, exiftool decimal degrees: both are one to three numbers.
    parts = [float(number) for number in _NUMBER.findall(text)]
    if not 1 <= len(parts) <= 3:
        return None
    size = sum(part / 60**power for power, part in enumerate(parts))
    return -size if reference.strip().upper().startswith(("S", "W")) else size


def focal_mm(tags: dict[str, str]) -> float | None:
    """The focal length in millimetres; None where it is absent or 0, which lenses without contacts report."""
    found = _NUMBER.search(tags.get("FocalLength", ""))
    return float(found[0]) if found and float(found[0]) > 0 else None


def camera_name(header: Header) -> str | None:
    """Maker, model and size, as far as the tags contain them: "DJI FC300S, 4000 x 2250 px"; None where no camera is named."""
    words = [header.tags.get(name, "").strip() for name in ("Make", "Model")]
    # Some makers repeat their name in the model: "Canon", "Canon EOS 550D".
    name = words[1] if words[0] and words[1].lower().startswith(words[0].lower()) else " ".join(word for word in words if word)
    return f"{name}, {header.width} x {header.height} px" if name else None
