"""Longitude and latitude from EXIF, or from the maker's own tags where EXIF was lost or holds none."""

from collections.abc import Mapping

from orthomill.tasks.photos import exif
from orthomill.tasks.photos.tags.makers import maker_number


def place_of(tags: Mapping[str, str]) -> tuple[float, float] | None:
    """Degrees, east and north positive; None without a position."""
    # DJI misspelt the longitude in its first drones with RTK.
    longitude = maker_number(tags, "GpsLongitude", "GpsLongtitude", "Longitude")
    latitude = maker_number(tags, "GpsLatitude", "Latitude")
    by_maker = None if longitude is None or latitude is None else exif.on_earth(longitude, latitude)
    return exif.longitude_latitude(tags) or by_maker
