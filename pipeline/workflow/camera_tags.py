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


def utm_zone(longitude: float, latitude: float) -> str:
    """The EPSG code of the UTM zone (WGS 84) of a position, e.g. "EPSG:32634", with the exceptions of Norway and Svalbard."""
    zone = min(int((longitude + 180) // 6) + 1, 60)
    # Zone 32 is widened to cover south-western Norway; around Svalbard only the odd zones 31 to 37 are used.
    if 56 <= latitude < 64 and 3 <= longitude < 12:
        zone = 32
    if 72 <= latitude <= 84 and 0 <= longitude < 42:
        zone = 31 + 2 * int((longitude + 3) // 12)
    return f"EPSG:{'326' if latitude >= 0 else '327'}{zone:02d}"


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
