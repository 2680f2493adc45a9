"""Longitude and latitude from EXIF, or from the maker's own tags where EXIF was lost or holds none."""

import math
from collections.abc import Mapping

from orthomill.schemas.survey_files.written_steps import METRES_OF_A_DEGREE
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.tags.makers import maker_number


def place_of(tags: Mapping[str, str]) -> tuple[float, float] | None:
    """Degrees, east and north positive; None without a position."""
    return exif.longitude_latitude(tags) or _by_maker(tags)


def places_apart(tags: Mapping[str, str]) -> float:
    """m between the places of EXIF and of the maker's own tags; 0 where one of them is missing."""
    by_exif, by_maker = exif.longitude_latitude(tags), _by_maker(tags)
    if by_exif is None or by_maker is None:
        return 0.0
    # Across the date line the longitudes of neighbours differ by nearly 360 degrees.
    east = ((by_exif[0] - by_maker[0] + 180.0) % 360.0 - 180.0) * math.cos(math.radians(by_exif[1]))
    return METRES_OF_A_DEGREE * math.hypot(east, by_exif[1] - by_maker[1])


def _by_maker(tags: Mapping[str, str]) -> tuple[float, float] | None:
    # DJI misspelt the longitude in its first drones with RTK.
    longitude = maker_number(tags, "GpsLongitude", "GpsLongtitude", "Longitude")
    latitude = maker_number(tags, "GpsLatitude", "Latitude")
    return None if longitude is None or latitude is None else exif.on_earth(longitude, latitude)
