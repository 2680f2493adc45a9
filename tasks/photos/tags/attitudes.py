"""Attitudes from tags: the yaw, pitch and roll of a gimbal or of an aircraft to the rotation of its photograph.

Two conventions. A gimbal (DJI and all that follow it): north, east, down, rotations in the order yaw, pitch, roll; the camera looks
along the first axis, so that -90 degrees of pitch look down. Pix4D's (Parrot, senseFly, MicaSense): the same rotations of the
aircraft, whose camera looks along the third axis, so that all angles are 0 over a photograph of the ground with north at its top.
Parrot's Anafi and Skydio name the camera's own angles as a gimbal has them; no file of theirs was at hand.
Yaw is from true north; the map's north differs by the meridian convergence.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo, tag_text
from orthomill.tasks.geometry.reference_system import ground_coordinates, on_earth
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.tags.makers import MAKERS

Angles = tuple[float, float, float]

_TO_EAST_NORTH_UP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""From north, east, down to east, north, up."""
# Columns: the axes of the image (x to the right, y to its top, z against the view) in those of the gimbal or the aircraft, which
# point forward, to the right and down.
_LOOKS_FORWARD = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_LOOKS_DOWN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_AXES = ("Yaw", "Pitch", "Roll")
_GIMBALS = (
    *(tuple(f"{prefix}:Gimbal{name}Degree" for name in _AXES) for prefix in MAKERS),
    tuple(f"drone-parrot:Camera{name}Degree" for name in _AXES),
    tuple(f"drone-skydio:CameraOrientationNED/drone-skydio:{name}" for name in _AXES),
)
_NOTE = tuple(f"MakerNote:Camera{name}" for name in _AXES)
_PIX4D, _SENSEFLY = (tuple(f"{prefix}:{name}" for name in _AXES) for prefix in ("Camera", "sensefly"))
_NORTH = 1e-4
"""degrees of latitude: about ten metres, over which the map's north does not turn"""


class Attitude(NamedTuple):
    """omega, phi, kappa in degrees, where north is true north, and what they were measured of."""

    angles: Angles
    of: Literal["gimbal", "aircraft"]


def attitude_of(tags: Mapping[str, str]) -> Attitude | None:
    """The attitude that the tags give; None without a complete one."""
    found = (_triple(tags, names) for names in _GIMBALS)
    if gimbal := next(filter(None, found), None):
        return Attitude(rotated(gimbal, _LOOKS_FORWARD), "gimbal")
    # Three zeros are a note that was never filled in.
    if (note := _triple(tags, _NOTE)) and any(note):
        return Attitude(rotated(note, _LOOKS_FORWARD), "gimbal")
    if body := _triple(tags, _PIX4D):
        return Attitude(rotated(body, _LOOKS_DOWN), "aircraft")
    if body := _triple(tags, _SENSEFLY):
        # Its roll counts the other way.
        return Attitude(rotated((body[0], body[1], -body[2]), _LOOKS_DOWN), "aircraft")
    return None


def _triple(tags: Mapping[str, str], names: tuple[str, ...]) -> Angles | None:
    """Yaw, pitch and roll in degrees; a roll that is not there is 0."""
    yaw, pitch, roll = (exif.numbers(tags, name) for name in names)
    if not yaw or not pitch or (not roll and tag_text(tags, names[2])):
        return None
    found = yaw[0], pitch[0], roll[0] if roll else 0.0
    return found if all(abs(angle) <= 360.0 for angle in found) else None


def rotated(yaw_pitch_roll: Angles, mount: np.ndarray) -> Angles:
    """omega, phi, kappa in degrees of a camera whose image axes lie in those of its carrier as `mount` (3, 3) says, after the
    carrier was turned by yaw (clockwise from north), pitch (nose up) and roll (right wing down), degrees."""
    y, p, r = np.radians(yaw_pitch_roll)
    yaw = np.array([[np.cos(y), -np.sin(y), 0.0], [np.sin(y), np.cos(y), 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[np.cos(p), 0.0, np.sin(p)], [0.0, 1.0, 0.0], [-np.sin(p), 0.0, np.cos(p)]])
    roll = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(r), -np.sin(r)], [0.0, np.sin(r), np.cos(r)]])
    return _degrees((_TO_EAST_NORTH_UP @ yaw @ pitch @ roll @ mount).T)


def turned_north(attitude: Angles, north: float) -> Angles:
    """The attitude in a system in which true north has the azimuth `north` (degrees clockwise from the Y axis)."""
    a = np.radians(north)
    turn = np.array([[np.cos(a), np.sin(a), 0.0], [-np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    return _degrees(rotation_matrix(*np.radians(attitude)) @ turn.T)


def on_map(photos: list[Photo], crs: str) -> list[Photo]:
    """The photographs with their attitudes in the project's system; as they are where that is none of the earth."""
    placed = [photo for photo in photos if photo.attitude is not None and photo.longitude is not None]
    if not placed or not on_earth(crs):
        return photos
    try:
        north = true_north(crs, np.array([(photo.longitude, photo.latitude) for photo in placed], float))
    except WorkflowError:
        # Tags of another part of the world: whoever uses the positions says so.
        return photos
    # A photograph without a position of its own is near the others.
    of_photo = dict(zip((photo.name for photo in placed), north.tolist(), strict=True))
    usual = float(np.median(north))
    return [
        photo.model_copy(update={"attitude": turned_north(photo.attitude, of_photo.get(photo.name, usual))})
        if photo.attitude is not None
        else photo
        for photo in photos
    ]


def true_north(crs: str, longitude_latitude: np.ndarray) -> np.ndarray:
    """(N,) azimuths of true north on the map (minus the meridian convergence), degrees clockwise from its Y axis, at (N, 2)
    degrees."""
    here, there = (ground_coordinates(crs, longitude_latitude + np.array([0.0, step])) for step in (-_NORTH / 2, _NORTH / 2))
    east, north = (there - here).T
    return np.degrees(np.arctan2(east, north))


def _degrees(rotation: np.ndarray) -> Angles:
    omega, phi, kappa = np.degrees(angles(rotation))
    return float(omega), float(phi), float(kappa)
