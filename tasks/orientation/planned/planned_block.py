"""A block before anything is matched: where its photographs were taken, how they look, and how high they are above the ground.

Attitudes that are not known are those of a mapping flight: straight down, the shorter side of the frame along the line of flight.
The height of the ground follows from heights above the place of take-off, or from where oblique views meet; where neither is known
it is guessed from the usual overlap, and told as a guess.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.rotation import rotation_matrix

USUAL_OVERLAP = 0.75
"""Overlap along the line of flight that a flying height is guessed from: what planning programs propose."""
LEAST_HEIGHT = 2.0
"""m: lower heights above the place of take-off are noise of a barometer, or a take-off from a roof."""
CONVERGING = np.radians(15.0)
"""Spread of views (root mean square) from which on the place where they meet is known better than the usual overlap."""
ONE_PLACE = 0.05
"""Extent of all places in units of the flying height up to which they are one: such a base gives no heights."""
TOLD_APART = 2.0
"""Extent of all places in units of their standard error below which positions tell nothing of a flight: a walk about an object with
a phone. A drone's satellites err alike over a flight, but no flight is as small as that."""
HeightSource = Literal["relative", "views", "overlap"]


@dataclass(frozen=True, eq=False)
class PlannedBlock:
    """`centre` (P, 3) m about `origin` (3,), in the order of exposure; `rotation` (P, 3, 3) world to image; `looks` (P,) bool:
    whose attitude is known; `sigma` (P, 3) m of the positions, and `common` (P,) bool: whose errors a whole flight has in common;
    `camera_of` (P,) numbers in `cameras`; the height of the `ground`, and what it rests on."""

    centre: np.ndarray
    rotation: np.ndarray
    looks: np.ndarray
    sigma: np.ndarray
    common: np.ndarray
    camera_of: np.ndarray
    cameras: tuple[Camera, ...]
    origin: np.ndarray
    ground: float
    height_from: HeightSource

    @property
    def height(self) -> float:
        """The median flying height above the ground, m."""
        return float(np.median(self.centre[:, 2]) - self.ground)

    @property
    def pixel(self) -> float:
        """The side of a pixel on the ground, m."""
        return self.height / float(np.median([self.cameras[k].c for k in self.camera_of]))

    @property
    def axes(self) -> np.ndarray:
        """(P, 3) directions of view."""
        return -self.rotation[:, 2]

    @property
    def spread(self) -> float:
        """Root mean square angle, rad, of the directions of view to their mean."""
        mean = self.axes.mean(axis=0)
        cosine = self.axes @ (mean / max(float(np.linalg.norm(mean)), 1e-12))
        return float(np.sqrt((np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2).mean()))

    def take(self, index: np.ndarray) -> "PlannedBlock":
        """The block of the photographs at `index`."""
        own = {name: getattr(self, name)[index] for name in ("centre", "rotation", "looks", "sigma", "common", "camera_of")}
        return replace(self, **own)


def planned_block(photos: Photos, cameras: Cameras) -> PlannedBlock | None:
    """The block of the photographs with a position; None for fewer than two places in plan, and where a
    flying height neither is known nor can be guessed, or can be guessed only from errors of the positions."""
    known = in_time([photo for photo in photos.photos if photo.position is not None and photo.position_sigma is not None])
    # Copies under another name have no base with what they are copies of.
    placed = list({(photo.position, photo.time): photo for photo in reversed(known)}.values())[::-1]
    if len({photo.position[:2] for photo in placed if photo.position}) < 2:
        return None
    position = np.array([photo.position for photo in placed], float)
    names = tuple(dict.fromkeys(cameras.of_photo[photo.name] for photo in placed))
    origin = np.round(np.median(position, axis=0))
    block = PlannedBlock(
        centre=position - origin,
        rotation=_rotations(placed, position),
        looks=np.array([photo.attitude is not None for photo in placed]),
        sigma=np.array([photo.position_sigma for photo in placed], float),
        # Code solutions err by satellites' orbits and the air, alike for all photographs of a flight; corrections take that out.
        common=np.array([photo.fix != "fixed" for photo in placed]),
        camera_of=np.array([names.index(cameras.of_photo[photo.name]) for photo in placed]),
        cameras=tuple(cameras.cameras[name] for name in names),
        origin=origin,
        ground=0.0,
        height_from="overlap",
    )
    above = _above_ground(block, placed)
    # Photographs from a drone that hovers have no base.
    if above is None or _extent(above) <= ONE_PLACE * above.height:
        return None
    return None if above.height_from == "overlap" and not tell_apart(placed) else above


def tell_apart(photos: Sequence[Photo]) -> bool:
    """Whether the places of photographs with positions differ by more than their standard errors."""
    plan = np.array([photo.position[:2] for photo in photos if photo.position])
    sigma = np.array([photo.position_sigma[:2] for photo in photos if photo.position_sigma])
    return float(np.linalg.norm(np.ptp(plan, axis=0))) > TOLD_APART * float(np.median(np.hypot(*sigma.T)))


def _extent(block: PlannedBlock) -> float:
    return float(np.linalg.norm(np.ptp(block.centre[:, :2], axis=0)))


def in_time(photos: Sequence[Photo]) -> list[Photo]:
    """Photographs flight by flight in the order of exposure; those without a time, or with the same one, in the order given."""
    return sorted(photos, key=lambda photo: (photo.flight, photo.time or ""))


def _rotations(placed: list[Photo], position: np.ndarray) -> np.ndarray:
    """(P, 3, 3): by the attitudes, else straight down with the top of the frame in the direction of flight."""
    step = np.gradient(position[:, :2], axis=0)
    kappa = np.arctan2(-step[:, 0], step[:, 1])
    return np.array(
        [
            rotation_matrix(0.0, 0.0, turn) if photo.attitude is None else rotation_matrix(*np.radians(photo.attitude))
            for photo, turn in zip(placed, kappa, strict=True)
        ]
    )


def _above_ground(block: PlannedBlock, placed: list[Photo]) -> PlannedBlock | None:
    relative = np.array([photo.relative_height or np.nan for photo in placed])
    if np.isfinite(relative).any() and np.nanmedian(relative) > LEAST_HEIGHT:
        return replace(block, ground=float(np.nanmedian(block.centre[:, 2] - relative)), height_from="relative")
    meeting = _meeting(block) if block.looks.all() and block.spread > CONVERGING else None
    if meeting is not None:
        return replace(block, ground=meeting, height_from="views")
    height = _usual_height(block)
    return None if height is None else replace(block, ground=float(np.median(block.centre[:, 2])) - height)


def _meeting(block: PlannedBlock) -> float | None:
    """The height of the point that the directions of view pass nearest to; None where they meet nowhere below."""
    across = np.eye(3) - block.axes[:, :, None] * block.axes[:, None, :]
    matrix, right = across.sum(axis=0), np.einsum("nij,nj->i", across, block.centre)
    if np.linalg.cond(matrix) > 1e3:
        return None
    meeting = float(np.linalg.solve(matrix, right)[2])
    return meeting if meeting < np.median(block.centre[:, 2]) - LEAST_HEIGHT else None


def _usual_height(block: PlannedBlock) -> float | None:
    """m above the ground with which neighbours in the line of flight have the usual overlap; None where all are in one place."""
    base = np.linalg.norm(np.diff(block.centre[:, :2], axis=0), axis=1)
    moved = base > 0
    if not moved.any():
        return None
    direction = np.diff(block.centre[:, :2], axis=0)[moved] / base[moved, None]
    lengths = frame_along(block, direction, np.flatnonzero(moved))
    return float(np.median(base[moved] / ((1.0 - USUAL_OVERLAP) * lengths)))


def frame_along(block: PlannedBlock, direction: np.ndarray, photo: np.ndarray) -> np.ndarray:
    """(n,) extent of the frames of photographs `photo` (n,) in horizontal `direction` (n, 2), through their middles, in units of
    the flying height; of photographs that look down."""
    size = np.array([(camera.width / camera.c, camera.height / camera.c) for camera in block.cameras])[block.camera_of[photo]]
    across = np.einsum("nij,nj->ni", block.rotation[photo, :2, :2], direction)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    return (size / np.maximum(np.abs(across), 1e-9)).min(axis=1)
