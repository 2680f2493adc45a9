"""Covariances between any two points of the ground and any two photographs, from what the adjustment stored.

A point is the intersection of the rays of the photographs that show it, so that X = N^-1 sum B'(image - f(orientations)): its error
follows the image measurements and, by G = -N^-1 B' A, the orientations and cameras, whose covariances are stored for photographs
that share tie points. Where a pair is not stored the covariance is not known, and no number is made up.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.orientation import Block
from orthomill.tasks.geometry.distortion import distorted, distortion_derivatives
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View, block_view

MOST = 8
"""photographs of which a point is intersected: those that show it nearest to their middle"""
_TURN = 1e-6
"""step of central differences, radians"""
_DOWN = np.array([[1.0], [-1.0]])
"""columns grow along x, rows against y"""


@dataclass(frozen=True)
class WeighedRays:
    """A quantity (n,) as its photographs determine it, a point by n = 3 coordinates: G (n, 6) by photograph, G (n, 17) by camera,
    and the covariance (n, n) of what was measured in the images."""

    by_photo: dict[str, np.ndarray]
    by_camera: dict[str, np.ndarray]
    measured: np.ndarray

    def plus(self, other: "WeighedRays", factor: float) -> "WeighedRays":
        """This and so many times another one that was measured in other photographs."""
        return WeighedRays(
            _sum(self.by_photo, other.by_photo, factor),
            _sum(self.by_camera, other.by_camera, factor),
            self.measured + factor**2 * other.measured,
        )

    def seen(self, by: np.ndarray) -> "WeighedRays":
        """What depends on it by (m, n) derivatives."""
        photos, cameras = ({name: by @ own for name, own in part.items()} for part in (self.by_photo, self.by_camera))
        return WeighedRays(photos, cameras, by @ self.measured @ by.T)


@dataclass(frozen=True)
class StoredCovariance:
    """The covariances of a block; `pixel`: standard error of an image coordinate, px."""

    block: Block
    pixel: float

    def of_photos(self, first: str, second: str) -> np.ndarray | None:
        """Covariance (6, 6) of two photographs, m and radians; None where it is not stored."""
        if first == second:
            own = self.block.of(first).covariance
            return None if own is None else np.array(own)
        return self._joint.get((first, second))

    def rays(self, point: np.ndarray) -> WeighedRays | None:
        """What determines a point (3,); None where fewer than two photographs with a covariance show it."""
        seen = [view for name in self.block.names if (view := self._shows(name, point)) is not None]
        seen = sorted(seen, key=lambda view: -float(view.within(view.project(point[None]))[0]))[:MOST]
        return self.rays_of(point, seen) if len(seen) >= 2 else None

    def rays_of(self, point: np.ndarray, views: list[View]) -> WeighedRays:
        """A point (3,) m as these photographs, two or more, determine it."""
        moves = {view.name: by_point(view, point) for view in views}
        normal = np.linalg.inv(sum((b.T @ b for b in moves.values()), np.zeros((3, 3))))
        by_photo: dict[str, np.ndarray] = {}
        by_camera: dict[str, np.ndarray] = {}
        for view in views:
            back = -normal @ moves[view.name].T
            by_photo[view.name] = back @ self._by_orientation(view, point)
            camera = self.block.of_photo[view.name]
            by_camera[camera] = by_camera.get(camera, np.zeros((3, len(INTERIOR)))) + back @ _by_interior(view, point)
        return WeighedRays(by_photo, by_camera, self.pixel**2 * normal)

    def ray_past(self, point: np.ndarray, view: View, others: WeighedRays) -> WeighedRays:
        """How far (2,) px the ray of a photograph goes past a point that others determine."""
        camera = self.block.of_photo[view.name]
        by_camera = {camera: _by_interior(view, point)}
        own = WeighedRays({view.name: self._by_orientation(view, point)}, by_camera, self.pixel**2 * np.eye(2))
        return own.plus(others.seen(by_point(view, point)), 1.0)

    def of_points(self, first: WeighedRays, second: WeighedRays) -> np.ndarray | None:
        """Covariance (3, 3) m2 of two points, or (m, n) of what else rays determine; that of a point with itself for the same rays;
        None where it is not stored."""
        total = first.measured.copy() if first is second else np.zeros((len(first.measured), len(second.measured)))
        for a, own in first.by_photo.items():
            for b, other in second.by_photo.items():
                joint = self.of_photos(a, b)
                if joint is None:
                    return None
                total += own @ joint @ other.T
        for here, there, turned in ((first, second, False), (second, first, True)):
            cross = self._with_cameras(here, there)
            total += cross.T if turned else cross
        return total + self._of_cameras(first, second)

    def _with_cameras(self, photos: WeighedRays, cameras: WeighedRays) -> np.ndarray:
        total = np.zeros((len(photos.measured), len(cameras.measured)))
        for name, own in photos.by_photo.items():
            stored = self.block.of(name).with_interior
            for camera, other in cameras.by_camera.items():
                if camera in stored:
                    total += own @ np.array(stored[camera]) @ other.T
        return total

    def _of_cameras(self, first: WeighedRays, second: WeighedRays) -> np.ndarray:
        total = np.zeros((len(first.measured), len(second.measured)))
        for a, own in first.by_camera.items():
            for b, other in second.by_camera.items():
                joint = self._camera(a, b)
                if joint is not None:
                    total += own @ joint @ other.T
        return total

    def _camera(self, first: str, second: str) -> np.ndarray | None:
        camera = self.block.cameras[first]
        if first == second:
            # A camera from elsewhere that the block kept as it was is not among its unknowns.
            return np.array(camera.covariance) if camera.source == "block" and camera.covariance is not None else None
        return self._joint_cameras.get((first, second))

    @cached_property
    def _joint(self) -> dict[tuple[str, str], np.ndarray]:
        return _both_ways((entry.first, entry.second, np.array(entry.covariance)) for entry in self.block.joint)

    @cached_property
    def _joint_cameras(self) -> dict[tuple[str, str], np.ndarray]:
        return _both_ways((entry.first, entry.second, np.array(entry.covariance)) for entry in self.block.joint_cameras)

    def _shows(self, name: str, point: np.ndarray) -> View | None:
        if self.block.of(name).covariance is None:
            return None
        view = block_view(self.block, name)
        return view if view.contains(view.project(point[None]))[0] else None

    def _by_orientation(self, view: View, point: np.ndarray) -> np.ndarray:
        """(2, 6): change of the pixel by X, Y, Z, omega, phi, kappa."""
        angles, away = np.radians(self.block.of(view.name).omega_phi_kappa), point - view.centre
        turns = [
            (rotation_matrix(*(angles + turn)) - rotation_matrix(*(angles - turn))) @ away / (2 * _TURN)
            for turn in np.eye(3) * _TURN
        ]
        return np.column_stack([-by_point(view, point), _by_place(view, point) @ np.column_stack(turns)])


def _sum(first: dict[str, np.ndarray], second: dict[str, np.ndarray], factor: float) -> dict[str, np.ndarray]:
    scaled = {name: factor * own for name, own in second.items()}
    return first | {name: first[name] + own if name in first else own for name, own in scaled.items()}


def _both_ways(entries: Iterable[tuple[str, str, np.ndarray]]) -> dict[tuple[str, str], np.ndarray]:
    out: dict[tuple[str, str], np.ndarray] = {}
    for first, second, covariance in entries:
        out[first, second], out[second, first] = covariance, covariance.T
    return out


def by_point(view: View, point: np.ndarray) -> np.ndarray:
    """(2, 3): change of the pixel by X, Y, Z of the point."""
    return _by_place(view, point) @ view.rotation


def _by_place(view: View, point: np.ndarray) -> np.ndarray:
    """(2, 3): change of the pixel by the coordinates of the point (3,) in the system of the camera."""
    x, y, z = view.rotation @ (point - view.centre)
    slopes, _ = distortion_derivatives(np.array([[-x / z, -y / z]]), view.numbers.lens)
    ideal = np.array([[-1.0 / z, 0.0, x / z**2], [0.0, -1.0 / z, y / z**2]])
    return np.asarray(_DOWN * view.camera.c * (slopes[0] @ ideal))


def _by_interior(view: View, point: np.ndarray) -> np.ndarray:
    """(2, 17): change of the pixel by the interior parameters, 0 for those that the lens lacks."""
    x, y, z = view.rotation @ (point - view.centre)
    ideal, lens = np.array([[-x / z, -y / z]]), view.numbers.lens
    _, partials = distortion_derivatives(ideal, lens)
    by = np.column_stack([distorted(ideal, lens)[0], np.eye(2), view.camera.c * partials[0]])
    return np.asarray(_DOWN * np.where(np.isin(INTERIOR, view.camera.parameters), by, 0.0))
