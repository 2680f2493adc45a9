"""Calibration from plane views: every board in every photograph is a plane with six unknowns of its own.

Observations are corners in pixels with equal weights. Unknown are the interior parameters that are left free, and rotation and
translation of every board. Start values come from OpenCV (Zhang 2000); Gauss-Newton steps follow, with the board unknowns
eliminated (Schur complement), so that the normal matrix never grows beyond 8 x 8. Corners beyond four robust standard
deviations are left out, then the adjustment is repeated. The covariance is that of the interior parameters with all board
unknowns estimated beside them, in our parametrisation (y up, principal point from the image centre, OpenCV's distortion numbers).

How far the formal precision can be trusted is measured twice: corners of photographs that took no part in the calibration
(held out), and the difference between the camera constants of two halves.

Source: Zhang 2000; Kawka 2021, sections S11 and S12 (methods/calibration.md), with boards left independent of each other.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from schemas.camera import INTERIOR, Camera
from schemas.errors import GeometryError

_OPENCV_COLUMNS = {"k1": 10, "k2": 11, "p1": 12, "p2": 13, "k3": 14}
"""Columns of the distortion in the Jacobian of cv2.projectPoints, behind rotation, translation, focal lengths and centre."""
FEWEST_BOARDS = 4
_LIMIT = 4.0
_LEAST_EIGENVALUE = 1e-7
"""Of the normal matrix scaled to a unit diagonal: 0.07 for tilted boards, 0.01 at 3 degrees, below 1e-8 without tilt."""


@dataclass(frozen=True)
class PlaneView:
    """One board in one photograph. plane: (N, 2) m on the board; pixels: (N, 2) (col, row)."""

    photo: str
    plane: np.ndarray
    pixels: np.ndarray

    def take(self, keep: np.ndarray) -> "PlaneView":
        return replace(self, plane=self.plane[keep], pixels=self.pixels[keep])


@dataclass(frozen=True)
class Solution:
    """A calibrated interior orientation. interior: (8,) and covariance (8, 8) in the order of INTERIOR; poses: (M, 6) rotation
    vector and translation of every board, OpenCV's camera frame; sigma0 in px."""

    interior: np.ndarray
    covariance: np.ndarray
    poses: np.ndarray
    sigma0: float
    iterations: int
    rejected: int
    views: tuple[PlaneView, ...]

    def residuals(self, size: tuple[int, int]) -> list[np.ndarray]:
        """Observed minus computed (N, 2) px of every view."""
        return [
            _linearised(view, self.interior, pose, size)[0].reshape(-1, 2)
            for view, pose in zip(self.views, self.poses, strict=True)
        ]


@dataclass(frozen=True)
class HeldOut:
    """What photographs say that took no part: root mean square per coordinate, and the camera constants of the two halves, px."""

    rms: float
    c_first: float
    c_second: float


def calibrate(views: list[PlaneView], size: tuple[int, int], free: tuple[str, ...]) -> Solution:
    """Interior orientation of a camera of `size` (width, height) with the parameters `free` estimated and the others zero.

    Raises GeometryError when there are too few boards or they do not determine the camera.
    """
    if len(views) < FEWEST_BOARDS:
        raise GeometryError(
            f"Only {len(views)} chessboards were found in the calibration photographs, and {FEWEST_BOARDS} are the least; "
            "check the number of inner corners in the workflow, or take more photographs with the whole board in view."
        )
    interior, poses = _start(views, size, free)
    first = _adjusted(views, interior, poses, size, free)
    kept = _without_outliers(first, size)
    rejected = sum(len(view.pixels) for view in views) - sum(len(view.pixels) for view in kept)
    if not rejected:
        return first
    return replace(_adjusted(kept, first.interior, first.poses, size, free), rejected=rejected)


def held_out(views: list[PlaneView], size: tuple[int, int], free: tuple[str, ...]) -> HeldOut | None:
    """Calibrate with every second photograph, measure on the others, and the other way round; None with too few boards."""
    names = sorted({view.photo for view in views})
    halves = [[view for view in views if names.index(view.photo) % 2 == half] for half in (0, 1)]
    if min(len(half) for half in halves) < FEWEST_BOARDS:
        return None
    try:
        solutions = [calibrate(half, size, free) for half in halves]
    except GeometryError:
        return None
    misses = [
        _miss(view, solution.interior, size) for solution, half in zip(solutions, reversed(halves), strict=True) for view in half
    ]
    rms = float(np.sqrt(np.mean(np.concatenate(misses) ** 2)))
    return HeldOut(rms, float(solutions[0].interior[0]), float(solutions[1].interior[0]))


def camera_of(solution: Solution, name: str, size: tuple[int, int]) -> Camera:
    """The camera of a solution."""
    numbers = dict(zip(INTERIOR, solution.interior.tolist(), strict=True))
    covariance = tuple(tuple(row) for row in solution.covariance.tolist())
    return Camera(
        name=name, width=size[0], height=size[1], source="chessboards", sigma0=solution.sigma0, covariance=covariance, **numbers
    )


def _start(views: list[PlaneView], size: tuple[int, int], free: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Start values (8,) and (M, 6) by OpenCV."""
    objects = [np.column_stack([view.plane, np.zeros(len(view.plane))]).astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    try:
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(objects, pixels, size, np.eye(3), None, flags=_flags(free))
    except cv2.error as error:
        raise GeometryError(
            "The chessboards do not determine the camera; photograph them tilted in different directions and over the whole frame."
        ) from error
    k1, k2, p1, p2, k3 = distortion.ravel()[:5]
    interior = np.array([matrix[0, 0], matrix[0, 2] - (size[0] - 1) / 2, (size[1] - 1) / 2 - matrix[1, 2], k1, k2, k3, p1, p2])
    interior[[name not in free for name in INTERIOR]] = 0.0
    poses = np.array([np.concatenate([turn.ravel(), shift.ravel()]) for turn, shift in zip(turns, shifts, strict=True)])
    return interior, poses


def _flags(free: tuple[str, ...]) -> int:
    fixed = {"k1": cv2.CALIB_FIX_K1, "k2": cv2.CALIB_FIX_K2, "k3": cv2.CALIB_FIX_K3, "p1": cv2.CALIB_ZERO_TANGENT_DIST}
    centre = 0 if "x0" in free else cv2.CALIB_FIX_PRINCIPAL_POINT
    return cv2.CALIB_FIX_ASPECT_RATIO | centre | sum(flag for name, flag in fixed.items() if name not in free)


def _linearised(
    view: PlaneView, interior: np.ndarray, pose: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Observed minus computed (2N,), and the derivatives of the computed by the interior (2N, 8) and the pose (2N, 6)."""
    c, x0, y0, k1, k2, k3, p1, p2 = interior
    matrix = np.array([[c, 0.0, x0 + (size[0] - 1) / 2], [0.0, c, (size[1] - 1) / 2 - y0], [0.0, 0.0, 1.0]])
    points = np.column_stack([view.plane, np.zeros(len(view.plane))])
    pixels, jacobian = cv2.projectPoints(points, pose[:3], pose[3:], matrix, np.array([k1, k2, p1, p2, k3]))
    by_camera = [jacobian[:, 6] + jacobian[:, 7], jacobian[:, 8], -jacobian[:, 9]]
    by_lens = [jacobian[:, _OPENCV_COLUMNS[name]] for name in INTERIOR[3:]]
    return view.pixels.ravel() - pixels.ravel(), np.column_stack(by_camera + by_lens), jacobian[:, :6]


def _adjusted(
    views: list[PlaneView], interior: np.ndarray, poses: np.ndarray, size: tuple[int, int], free: tuple[str, ...]
) -> Solution:
    """Gauss-Newton until no corner moves by 0.0001 px."""
    is_free = np.array([name in free for name in INTERIOR])
    interior, poses = interior.copy(), poses.copy()
    for iteration in range(1, 51):
        reduced, right, steps = _reduced_normals(views, interior, poses, size, is_free)
        change = _solved(reduced, right)
        interior[is_free] += change
        poses = poses + np.array([own - link @ change for own, link in steps])
        if _largest_move(interior, change, is_free, size) < 1e-4:
            return _with_precision(views, interior, poses, size, is_free, iteration)
    raise GeometryError("The calibration from chessboards does not converge; photograph boards tilted and over the whole frame.")


def _reduced_normals(
    views: list[PlaneView], interior: np.ndarray, poses: np.ndarray, size: tuple[int, int], is_free: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Normal matrix and right side of the free interior parameters, and for each pose (own step, link to the interior)."""
    count = int(is_free.sum())
    reduced, right, steps = np.zeros((count, count)), np.zeros(count), []
    for view, pose in zip(views, poses, strict=True):
        misfit, by_interior, by_pose = _linearised(view, interior, pose, size)
        by_interior = by_interior[:, is_free]
        solved = np.linalg.lstsq(by_pose, np.column_stack([misfit, by_interior]), rcond=None)[0]
        own, link = solved[:, 0], solved[:, 1:]
        rest = by_interior - by_pose @ link
        reduced += rest.T @ by_interior
        right += rest.T @ misfit
        steps.append((own, link))
    return reduced, right, steps


def _solved(reduced: np.ndarray, right: np.ndarray) -> np.ndarray:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(reduced), 1e-300))
    scaled = reduced * scale[:, None] * scale[None, :]
    if not np.isfinite(scaled).all() or np.linalg.eigvalsh(scaled)[0] < _LEAST_EIGENVALUE:
        raise GeometryError(
            "The chessboards do not determine the camera; photograph them tilted in different directions and over the whole frame."
        )
    return scale * np.linalg.solve(scaled, scale * right)


def _largest_move(interior: np.ndarray, change: np.ndarray, is_free: np.ndarray, size: tuple[int, int]) -> float:
    """How far a step of the interior parameters moves the corners of the frame, px."""
    half = np.array(size) / 2 / interior[0]
    radius = float(np.hypot(*half))
    reach = np.array([radius, 1.0, 1.0, *(interior[0] * radius ** np.array([3, 5, 7, 2, 2]))])
    return float(np.abs(reach[is_free] * change).max())


def _with_precision(
    views: list[PlaneView], interior: np.ndarray, poses: np.ndarray, size: tuple[int, int], is_free: np.ndarray, iterations: int
) -> Solution:
    reduced, _, _ = _reduced_normals(views, interior, poses, size, is_free)
    squares = sum(float((_linearised(view, interior, pose, size)[0] ** 2).sum()) for view, pose in zip(views, poses, strict=True))
    redundancy = 2 * sum(len(view.pixels) for view in views) - 6 * len(views) - int(is_free.sum())
    sigma0 = float(np.sqrt(squares / redundancy))
    covariance = np.zeros((len(INTERIOR), len(INTERIOR)))
    covariance[np.ix_(is_free, is_free)] = sigma0**2 * np.linalg.inv(reduced)
    return Solution(interior, (covariance + covariance.T) / 2, poses, sigma0, iterations, 0, tuple(views))


def _without_outliers(solution: Solution, size: tuple[int, int]) -> list[PlaneView]:
    residuals = solution.residuals(size)
    sigma = 1.4826 * float(np.median(np.abs(np.concatenate(residuals))))
    limit = _LIMIT * max(sigma, 1e-6)
    return [view.take(np.abs(residual).max(axis=1) <= limit) for view, residual in zip(solution.views, residuals, strict=True)]


def _miss(view: PlaneView, interior: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Residuals (2N,) px of a view with only its pose estimated."""
    c, x0, y0, k1, k2, k3, p1, p2 = interior
    matrix = np.array([[c, 0.0, x0 + (size[0] - 1) / 2], [0.0, c, (size[1] - 1) / 2 - y0], [0.0, 0.0, 1.0]])
    points = np.column_stack([view.plane, np.zeros(len(view.plane))])
    _, turn, shift = cv2.solvePnP(points, view.pixels, matrix, np.array([k1, k2, p1, p2, k3]), flags=cv2.SOLVEPNP_IPPE)
    pose = np.concatenate([turn.ravel(), shift.ravel()])
    for _ in range(20):
        misfit, _, by_pose = _linearised(view, interior, pose, size)
        step = np.linalg.lstsq(by_pose, misfit, rcond=None)[0]
        pose = pose + step
        if np.abs(step).max() < 1e-10:
            break
    return _linearised(view, interior, pose, size)[0]
