"""Targets that name themselves: AprilTag and ArUco, found by OpenCV.

Only codes without a single wrong bit count: on photographs of whole landscapes error correction finds codes where there are none.
The centre is where the diagonals meet, which perspective does not move.
"""

import cv2
import numpy as np

from orthomill.schemas.marks import FoundTarget

DICTIONARIES = {
    "tag36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "aruco4x4": cv2.aruco.DICT_4X4_50,
    "aruco5x5": cv2.aruco.DICT_5X5_100,
    "aruco6x6": cv2.aruco.DICT_6X6_250,
}
LEAST_SIDE = 10.0
"""px: sides of smaller squares show no bits"""
CENTRE_SIGMA = 0.17
"""px: standard error of a centre by refined corners (benchmarks/results/drawn_targets.md)"""


def coded_targets(grey: np.ndarray) -> list[FoundTarget]:
    """The coded targets of a grey image (rows, cols) uint8, sorted by name."""
    found: dict[str, FoundTarget | None] = {}
    for family, number in DICTIONARIES.items():
        corners, names, _ = _detector(number).detectMarkers(grey)
        for quad, name in zip(corners, [] if names is None else np.ravel(names), strict=False):
            quad = quad.reshape(4, 2).astype(np.float64)
            side = float(np.linalg.norm(np.diff(np.vstack([quad, quad[:1]]), axis=0), axis=1).min())
            place = crossing(quad)
            if side >= LEAST_SIDE and np.isfinite(place).all():
                # Twice in a photograph is a copy of it, on paper or in a window: neither is known to be the point.
                key = f"{family}-{int(name)}"
                found[key] = (
                    None
                    if key in found
                    else FoundTarget("coded", (float(place[0]), float(place[1])), CENTRE_SIGMA, side / 2.0, 1.0, key)
                )
    return [one for _, one in sorted(found.items()) if one is not None]


def _detector(number: int) -> "cv2.aruco.ArucoDetector":
    rules = cv2.aruco.DetectorParameters()
    rules.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    rules.errorCorrectionRate = 0.0
    rules.minMarkerPerimeterRate = 0.005
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(number), rules)


def crossing(quad: np.ndarray) -> np.ndarray:
    """(2,) where the diagonals of a quadrangle (4, 2) meet; NaN where they are parallel."""
    a, b, c, d = quad
    along, across = c - a, d - b
    area = along[0] * across[1] - along[1] * across[0]
    if abs(area) < 1e-9:
        return np.full(2, np.nan)
    between = b - a
    return a + along * ((between[0] * across[1] - between[1] * across[0]) / area)
