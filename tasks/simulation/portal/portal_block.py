"""The seven photographs of the portal and their camera, after the first application of Petsa et al. (2007).

Camera: that of Table 1 (sources/blending.md#table-1), 2592 x 1944 px. Its polynomial is taken as what is added to the ideal
radius to give the observed one: the sign that makes k1 < 0 the barrel distortion that cameras of its kind have. Photographs are
taken from the ground, 6 to 8 m away, two of them upright; the facade is turned in plan, so that no axis of the system is along it.
"""

import numpy as np

from orthomill.schemas.camera import BrownLens, Camera
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.view import View, view_of
from orthomill.tasks.simulation.flight import FlightExposure, block_of_truth

ORIGIN = np.array([120.0, 240.0, 70.0])
"""m: the middle of the threshold in the surveyor's local system"""
AZIMUTH = 20.0
"""degrees by which the facade is turned, counterclockwise"""
FULL = (2592, 1944)
_C, _X0, _Y0, _K1, _K2 = 2573.94, 10.27, 7.35, -2.98e-8, 4.90e-15
_STATIONS = (
    # position (m along the facade, in front of it, above the ground), point looked at, roll in degrees
    ((-3.4, 6.5, 1.65), (0.5, 0.0, 2.75), 1.1),
    ((-1.9, 7.6, 1.70), (0.2, 0.0, 2.70), -0.8),
    ((0.1, 8.1, 1.62), (0.0, 0.0, 2.65), 0.6),
    ((2.0, 7.5, 1.72), (-0.2, 0.0, 2.70), 1.5),
    ((3.6, 6.3, 1.66), (-0.5, 0.0, 2.75), -1.3),
    ((-1.0, 7.0, 2.45), (0.1, 0.0, 2.60), 90.7),
    ((1.3, 6.8, 2.30), (-0.1, 0.0, 2.60), -89.2),
)
_EXPOSURES = 6  # stream of random numbers; 1 to 5 belong to the flight and its survey


def turn() -> np.ndarray:
    """(3, 3): from the portal's axes (right, into the wall, up) to the surveyor's."""
    a = np.radians(AZIMUTH)
    return np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])


def to_system(points: np.ndarray) -> np.ndarray:
    """Points (..., 3) along the portal's axes in the surveyor's system, m."""
    return ORIGIN + points @ turn().T


def to_portal(points: np.ndarray) -> np.ndarray:
    """Points (..., 3) of the surveyor's system along the portal's axes, m."""
    return (points - ORIGIN) @ turn()


def portal_camera(reduction: float = 1.0) -> Camera:
    """The camera, with photographs smaller by `reduction` and the same field of view."""
    width, height = (round(side / reduction) for side in FULL)
    scale = width / FULL[0]
    # Reports and files use radii in units of c; Table 1 has pixels.
    return Camera(
        name="portal",
        width=width,
        height=height,
        c=_C * scale,
        x0=_X0 * scale,
        y0=_Y0 * scale,
        lens=BrownLens(k1=_K1 * _C**2, k2=_K2 * _C**4),
        pixel_um=2.7 / scale,
        source="truth",
    )


def portal_orientations() -> tuple[ExteriorOrientation, ...]:
    """The true exterior orientations."""
    return tuple(_orientation(number, *station) for number, station in enumerate(_STATIONS, 1))


def _orientation(
    number: int, place: tuple[float, float, float], aim: tuple[float, float, float], roll: float
) -> ExteriorOrientation:
    centre = to_system(np.array([place[0], -place[1], place[2]]))
    away = centre - to_system(np.array([aim[0], -aim[1], aim[2]]))
    back = away / np.linalg.norm(away)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    level, a = np.array([right, np.cross(back, right), back]), np.radians(roll)
    tilted = np.array([[np.cos(a), np.sin(a), 0.0], [-np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]]) @ level
    # Rounded as they are written to files, so that what is read back is the truth to the last digit.
    x, y, z = centre.round(4).tolist()
    omega, phi, kappa = np.degrees(angles(tilted)).round(5).tolist()
    return ExteriorOrientation(photo=f"portal_{number}", centre=(x, y, z), omega_phi_kappa=(omega, phi, kappa))


def portal_views(reduction: float = 1.0) -> tuple[View, ...]:
    """The true views."""
    camera = portal_camera(reduction)
    return tuple(view_of(orientation, camera) for orientation in portal_orientations())


def portal_exposure(seed: int, number: int) -> FlightExposure:
    """Brightness of photograph `number`, counted from 0."""
    generator = np.random.default_rng([seed, _EXPOSURES, number])
    gain = generator.uniform(0.82, 1.14) * (1.0 + generator.uniform(-0.03, 0.03, 3))
    red, green, blue = gain.round(4).tolist()
    offset, vignetting = round(float(generator.uniform(-4.0, 8.0)), 2), round(float(generator.uniform(0.06, 0.2)), 3)
    return FlightExposure(number, (red, green, blue), offset, vignetting)


def portal_block(crs: str, reduction: float = 1.0) -> Block:
    """All true orientations and the camera as a block."""
    heights = float(ORIGIN[2]), float(ORIGIN[2] + 8.0)
    return block_of_truth(crs, portal_camera(reduction), portal_orientations(), heights)
