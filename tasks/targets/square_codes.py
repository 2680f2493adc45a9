"""Square targets that name themselves: AprilTag and ArUco, found by OpenCV.

Only codes without a single wrong bit count, in the photograph and enlarged: on photographs of whole landscapes error
correction finds codes where there are none.
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
CENTRE_SIGMA = 0.06
"""px: standard error of a centre by the lines of the border (benchmarks/results/drawn_targets.md)"""
FINER = 2
"""Times finer than the photograph is the part in which corners are measured."""
CORNERS = 0.5
"""px: OpenCV's lines of a border count from the corner of the first pixel, we from its centre."""


def square_codes(grey: np.ndarray) -> list[FoundTarget]:
    """The AprilTags and ArUco codes of a grey image (rows, cols) uint8, each as often as it shows."""
    found = []
    for family, number in DICTIONARIES.items():
        detector = _detector(number)
        for name, rough in _codes(detector, grey, 1):
            quad = _measured(detector, grey, name, rough)
            if quad is None:
                continue
            side = float(np.linalg.norm(np.diff(np.vstack([quad, quad[:1]]), axis=0), axis=1).min())
            place = crossing(quad)
            if side >= LEAST_SIDE and np.isfinite(place).all():
                found.append(
                    FoundTarget("coded", (float(place[0]), float(place[1])), CENTRE_SIGMA, side / 2.0, 1.0, f"{family}-{name}")
                )
    return found


def _codes(detector: "cv2.aruco.ArucoDetector", grey: np.ndarray, finer: int) -> list[tuple[int, np.ndarray]]:
    """Codes and their corners (4, 2) px of an image that is `finer` times the photograph, in px of that."""
    corners, names, _ = detector.detectMarkers(grey)
    numbers = [] if names is None else np.ravel(names)
    return [
        (int(name), (quad.reshape(4, 2).astype(np.float64) - CORNERS + 0.5) / finer - 0.5)
        for name, quad in zip(numbers, corners, strict=False)
    ]


def _measured(detector: "cv2.aruco.ArucoDetector", grey: np.ndarray, name: int, rough: np.ndarray) -> np.ndarray | None:
    """The corners (4, 2) px of a code, measured in an enlarged part of the image; None where it does not show there again: what is
    read from leaves and gravel depends on the size of pixels."""
    room = 0.4 * float(np.ptp(rough, axis=0).max()) + 8.0
    left, top = np.maximum(np.floor(rough.min(axis=0) - room).astype(int), 0)
    right, low = np.ceil(rough.max(axis=0) + room).astype(int) + 1
    part = cv2.resize(grey[top:low, left:right], None, fx=FINER, fy=FINER, interpolation=cv2.INTER_CUBIC)
    finer = [quad + np.array([left, top]) for own, quad in _codes(detector, part, FINER) if own == name]
    return finer[0] if len(finer) == 1 else None


def _detector(number: int) -> "cv2.aruco.ArucoDetector":
    rules = cv2.aruco.DetectorParameters()
    # Finds quadrangles by lines of gradients, which blur and soft borders do not break.
    rules.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
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
