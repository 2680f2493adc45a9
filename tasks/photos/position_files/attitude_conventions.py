"""Attitudes from the angles that drones and programs write, as omega, phi, kappa in degrees.

Yaw turns clockwise from north, pitch lifts the nose, roll lowers the right wing, in this order about the axes of the aircraft
(forward, right, down); the camera looks down, the top of the photograph towards the nose. Thus all 0 is nadir with north up.
Source: Pix4D, "Yaw, Pitch, Roll and Omega, Phi, Kappa angles and conversion" (2018); Metashape's manual uses the same angles.
Gimbals count the pitch of the line of sight instead, -90 at nadir; that of senseFly's files has the roll of the opposite sign
(OpenDroneMap, photo.py).
"""

import numpy as np

from orthomill.tasks.geometry.rotation import angles

_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""north, east, down -> east, north, up"""
_IMAGE_IN_BODY = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Rows: the axes of the photograph (right, up, against the view) in those of the aircraft."""
_GIMBAL = -45.0
"""degrees: the median pitch below which it is that of a line of sight, for no aircraft flies on its tail"""


def from_yaw_pitch_roll(yaw: float, pitch: float, roll: float, north: float = 0.0) -> tuple[float, float, float]:
    """omega, phi, kappa in degrees; `north`: its direction on the map, degrees clockwise from the y axis."""
    y, p, r = np.radians([yaw + north, pitch, roll])
    about_down = np.array([[np.cos(y), -np.sin(y), 0.0], [np.sin(y), np.cos(y), 0.0], [0.0, 0.0, 1.0]])
    about_right = np.array([[np.cos(p), 0.0, np.sin(p)], [0.0, 1.0, 0.0], [-np.sin(p), 0.0, np.cos(p)]])
    about_nose = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(r), -np.sin(r)], [0.0, np.sin(r), np.cos(r)]])
    body_to_world = _FROM_NED @ about_down @ about_right @ about_nose
    omega, phi, kappa = np.degrees(angles((body_to_world @ _IMAGE_IN_BODY.T).T))
    return float(omega), float(phi), float(kappa)


def is_line_of_sight(pitches: list[float]) -> bool:
    """Whether pitches (degrees) are those of a gimbal, -90 at nadir, and not of an aircraft."""
    return bool(pitches) and float(np.median(pitches)) < _GIMBAL
