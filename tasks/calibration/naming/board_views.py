"""The board views of one photograph: by homographies when the boards lie on one plane, by poses when they lie anywhere in space.

Either kind gives the three things that identification needs: the projection (3, 4) of the photo from some boards that are known in
the map, the place of another of its boards in the map, and the places of its boards relative to each other. A homography needs
neither camera constant nor pose, but is valid on its plane only. A pose is valid anywhere, but needs c and image coordinates free
of distortion.

A projection takes points (X, Y, Z, 1) of the map to image coordinates times their third component, which is negative in front of
the camera. A place is a (4, 4) rigid motion from a board's own system into the map.

Source: Kawka 2021, S3, S5 and S6 (sources/calibration.md); Kabsch 1976 for the poses.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from orthomill.tasks.calibration.detection.board_turns import in_order
from orthomill.tasks.calibration.detection.homographies import applied, homography, refined_together, rigid_motion
from orthomill.tasks.geometry.rotation import nearest_rotation


class BoardViews(Protocol):
    """`xy` (B, N, 2) px from the image centre, y up: the corners of the boards of a photo, NaN where one is not known."""

    @property
    def xy(self) -> np.ndarray: ...

    @property
    def orders(self) -> np.ndarray:
        """(T, N): the orders in which the corners of a board may be counted (board_turns.py)."""
        ...

    def turned(self, turns: np.ndarray) -> "BoardViews":
        """The same boards with their corners counted in the orders `turns` (B,)."""
        ...

    def projection(self, boards: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(3, 4) from the photo's `boards` (n,), whose corners in the map are `points` (n, N, 3)."""
        ...

    def place(self, projection: np.ndarray, board: int) -> np.ndarray:
        """(4, 4): where the board lies in the map."""
        ...

    def together(self, boards: np.ndarray, places: np.ndarray) -> np.ndarray:
        """(n, 4, 4): the places of `boards` in the system of the first, as this photo has them; `places` (n, 4, 4) approximate."""
        ...


def on_map(places: np.ndarray, local: np.ndarray) -> np.ndarray:
    """(K, N, 3) m: the corners `local` (N, 2) of boards at `places` (K, 4, 4)."""
    return np.einsum("kij,nj->kni", places[:, :3, :2], local) + places[:, None, :3, 3]


def imaged(projection: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Image coordinates (..., 2) of points (..., 3) of the map; NaN behind the camera."""
    u = points @ projection[:, :3].T + projection[:, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(u[..., 2:] < 0, u[..., :2] / u[..., 2:], np.nan)


def in_plane(motion: np.ndarray) -> np.ndarray:
    """(4, 4) of a motion (angle, x, y) in the plane Z = 0."""
    place = np.eye(4)
    cos, sin = np.cos(motion[0]), np.sin(motion[0])
    place[:2, :2], place[:2, 3] = [[cos, -sin], [sin, cos]], motion[1:]
    return place


def motion_in_plane(place: np.ndarray) -> np.ndarray:
    """(3,) angle, x, y of a place in the plane Z = 0."""
    return np.array([np.arctan2(place[1, 0], place[0, 0]), *place[:2, 3]])


@dataclass(frozen=True, eq=False)
class PlaneViews:
    """Boards on the plane Z = 0 of the map; local: (N, 2) m."""

    xy: np.ndarray
    local: np.ndarray
    orders: np.ndarray

    def turned(self, turns: np.ndarray) -> "PlaneViews":
        """The corners in other orders."""
        return replace(self, xy=in_order(self.xy, turns, self.orders))

    def projection(self, boards: np.ndarray, points: np.ndarray) -> np.ndarray:
        """By a homography, with the sign that puts the boards in front of the camera."""
        xy = self.xy[boards]
        known = np.isfinite(xy).all(axis=-1)
        H = homography(points[known][:, :2], xy[known])
        # A homography is defined up to scale; the sign decides which side of the plane's horizon is imaged. The sum over all points
        # decides, as a corner close to the horizon of a poor first fit may fall on the wrong side.
        H *= -np.sign((points[known][:, :2] @ H[2, :2] + H[2, 2]).sum())
        return np.insert(H, 2, 0.0, axis=1)

    def place(self, projection: np.ndarray, board: int) -> np.ndarray:
        """By the motion in the plane that fits best (S5)."""
        known = np.isfinite(self.xy[board]).all(axis=-1)
        back = applied(np.linalg.inv(projection[:, [0, 1, 3]]), self.xy[board][known])
        return in_plane(rigid_motion(self.local[known], back))

    def together(self, boards: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Homography and motions adjusted together (S6)."""
        own = np.linalg.inv(places[0]) @ places
        motions = np.array([motion_in_plane(place) for place in own])
        H = self.projection(boards, on_map(own, self.local))[:, [0, 1, 3]]
        # The refinement parametrises H with h33 = 1; the sign of the projection is lost there and not needed.
        _, motions = refined_together(H / H[2, 2], motions, self.local, self.xy[boards])
        return np.array([in_plane(motion) for motion in motions])


@dataclass(frozen=True, eq=False)
class SpaceViews:
    """Boards anywhere in space. `poses` (B, 4, 4) take a board's own system into the camera's (x right, y up, z backwards), each
    from that board alone; `c` px; xy is free of distortion and relative to the principal point; local: (N, 2) m."""

    xy: np.ndarray
    local: np.ndarray
    poses: np.ndarray
    c: float
    orders: np.ndarray

    def turned(self, turns: np.ndarray) -> "SpaceViews":
        """The corners in other orders, and the poses of boards whose own axes have turned with them."""
        own = np.array([in_plane(rigid_motion(self.local, self.local[order])) for order in self.orders])
        return replace(self, xy=in_order(self.xy, turns, self.orders), poses=self.poses @ own[turns])

    def projection(self, boards: np.ndarray, points: np.ndarray) -> np.ndarray:
        """By the rigid motion that takes the points of the map onto those of the poses."""
        # All N corners, also of cut boards: the pose of a board predicts the corners that were not measured.
        M = _rigid(points.reshape(-1, 3), on_map(self.poses[boards], self.local).reshape(-1, 3))
        return np.diag([-self.c, -self.c, 1.0]) @ M[:3]

    def place(self, projection: np.ndarray, board: int) -> np.ndarray:
        """By the pose of the board itself."""
        return np.linalg.inv(self._motion(projection)) @ self.poses[board]

    def together(self, boards: np.ndarray, places: np.ndarray) -> np.ndarray:
        """By the poses alone; `places` is not needed."""
        return np.linalg.inv(self.poses[boards[0]]) @ self.poses[boards]

    def _motion(self, projection: np.ndarray) -> np.ndarray:
        return np.vstack([np.diag([-1.0 / self.c, -1.0 / self.c, 1.0]) @ projection, [0.0, 0.0, 0.0, 1.0]])


def _rigid(points: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """(4, 4) rigid motion of points (N, 3) onto others (N, 3), by least squares."""
    p, q = points.mean(axis=0), onto.mean(axis=0)
    R = nearest_rotation((onto - q).T @ (points - p))
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = R, q - R @ p
    return M
