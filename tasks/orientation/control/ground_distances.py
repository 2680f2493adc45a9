"""Measured distances on the map of the project: a tape measures on the ground, the block is computed on the map.

UTM is 0.04 % too small in the middle of its zone, and heights make the map smaller still: 20 mm on 40 m.
"""

import numpy as np

from orthomill.schemas.maps.map_scale import on_the_map as scaled
from orthomill.schemas.observations import ControlPoint, Distance
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import ANY_CRS
from orthomill.tasks.geometry.reference_system import on_earth
from orthomill.tasks.geometry.survey_system import scale_at


def on_the_map(distances: tuple[Distance, ...], points: tuple[ControlPoint, ...], photos: Photos, crs: str) -> tuple[Distance, ...]:
    """Distances (m on the ground) in metres of the project's map, where something tells its place on the Earth; of those whose
    direction is known only the horizontal part changes."""
    place = _place(points, photos)
    if not distances or place is None or crs == ANY_CRS or not on_earth(crs):
        return distances
    factor = scaled(scale_at(place[:2], crs), float(place[2]))
    known = {point.name: np.array(point.xyz) for point in points if point.role == "control"}
    return tuple(_scaled(distance, factor, known) for distance in distances)


def _place(points: tuple[ControlPoint, ...], photos: Photos) -> np.ndarray | None:
    """Where (3,) the distances were measured: at the control, or else below the photographs; None where nothing is known."""
    places = [point.xyz for point in points if point.role != "tie"]
    places = places or [photo.position for photo in photos.photos if photo.position is not None]
    return np.median(np.array(places, float), axis=0) if places else None


def _scaled(distance: Distance, factor: float, known: dict[str, np.ndarray]) -> Distance:
    level = 1.0
    if distance.first in known and distance.second in known:
        between = known[distance.second] - known[distance.first]
        level = float(np.hypot(*between[:2]) / max(np.linalg.norm(between), 1e-9))
    change = np.sqrt((level * factor) ** 2 + 1.0 - level**2)
    return distance.model_copy(update={"length": distance.length * float(change), "measured": distance.length})
