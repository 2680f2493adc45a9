"""Photographs that EXIF rotates upright, and others of the same camera: one sensor, one interior orientation.

Tables hold coordinates in upright photographs. In a photograph taken with the camera on its side, principal point and distortion
are rotated by a quarter turn, but the sensor is the same. A block is therefore oriented in the frames of the sensors, in which all
photographs of a camera share one interior orientation, and its tables are rotated back: quarter turns about the camera's axis,
exact in values and covariances. Blocks without such photographs pass unchanged.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.observations import Control, ControlPoint, ImageResiduals, TiePoints
from orthomill.schemas.orientation import Block, ExteriorOrientation, JointCovariance, LargestResidual
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.camera_change import (
    QUARTER_TURNS,
    TURN,
    interior_turn,
    pixel_turn,
    sensor_name,
    sensor_size,
    turned,
    turned_pixels,
)
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.geometry.rotation_vector import angles_from_vector
from orthomill.tasks.orientation.interchange.foreign_block import ForeignPose

_Turn = Callable[[Photo, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Sensors:
    """The input of a block in the frames of the sensors; `upright`: the frames of its photographs, `given`: approximate
    orientations, `tops`: directions (3,) in the image system to the tops of the photographs that are rotated against their
    sensors."""

    upright: "Upright"
    photos: Photos
    cameras: Cameras
    tie_points: TiePoints
    control: Control
    given: Mapping[str, ForeignPose] | None
    tops: Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Upright:
    """The photographs and cameras of the tables: rotated upright by EXIF."""

    photos: Photos
    cameras: Cameras

    def flag(self, name: str) -> int:
        """The EXIF orientation by which a photograph was rotated upright; 1 where the frame of its sensor is not known."""
        # A mirrored photograph has no sensor frame that a rotation reaches.
        flag = self.photos[name].sensor_orientation
        return flag if flag in QUARTER_TURNS else 1

    @property
    def anything(self) -> bool:
        """Whether any photograph was rotated."""
        return any(self.flag(name) != 1 for name in self.photos.names)

    def sensors(self, ties: TiePoints, control: Control, given: Mapping[str, ForeignPose] | None) -> Sensors:
        """Everything in the frames of the sensors; unchanged where no photograph was rotated."""
        if not self.anything:
            return Sensors(self, self.photos, self.cameras, ties, control, given, {})
        return Sensors(
            self,
            self.sensor_photos(),
            self.sensor_cameras(),
            self.sensor_ties(ties),
            self.sensor_control(control),
            self._sensor_poses(given),
            self._tops(),
        )

    def sensor_photos(self) -> Photos:
        """The photographs in the frames of their sensors."""
        return self.photos.model_copy(update={"photos": tuple(self._sensor_photo(photo) for photo in self.photos.photos)})

    def _sensor_photo(self, photo: Photo) -> Photo:
        flag = self.flag(photo.name)
        if flag == 1:
            return photo
        changed: dict[str, Any] = {"width": photo.height, "height": photo.width} if flag >= 5 else {}
        if photo.attitude is not None:
            rotation = _about_axis(flag).T @ rotation_matrix(*np.radians(photo.attitude))
            changed["attitude"] = tuple(float(v) for v in np.degrees(angles(rotation)))
        return photo.model_copy(update={"exif_orientation": 1, **changed})

    def _tops(self) -> dict[str, np.ndarray]:
        """Directions (3,) to the tops of the rotated photographs, in the image systems of their sensors."""
        return {name: _about_axis(self.flag(name)).T @ [0.0, 1.0, 0.0] for name in self.photos.names if self.flag(name) != 1}

    def sensor_cameras(self) -> Cameras:
        """The cameras of the sensors, and the camera of each photograph."""
        # The first photograph of a sensor stands for all: cameras of one sensor differ by their rotation only.
        of_photo = {name: self._sensor(name) for name in self.photos.names}
        first = {sensor: name for name, sensor in reversed(of_photo.items())}
        cameras = {sensor: self._turned_back(name, sensor) for sensor, name in sorted(first.items())}
        return Cameras(cameras=cameras, of_photo=of_photo)

    def _sensor(self, name: str) -> str:
        return sensor_name(self.cameras.of_photo[name]) if self.flag(name) != 1 else self.cameras.of_photo[name]

    def _turned_back(self, name: str, sensor: str) -> Camera:
        camera = self.cameras.of(name)
        return turned(camera, QUARTER_TURNS.get(self.flag(name), 1)).model_copy(update={"name": sensor})

    def sensor_ties(self, ties: TiePoints) -> TiePoints:
        """Tie points in pixels of the sensors' frames."""
        col, row = ties.col.copy(), ties.row.copy()
        for number, photo in enumerate(self.photos.photos):
            own = ties.photo == number
            if self.flag(photo.name) != 1 and own.any():
                col[own], row[own] = self._to_sensor(photo, np.column_stack([ties.col[own], ties.row[own]])).T
        return replace(ties, col=col, row=row)

    def sensor_control(self, control: Control) -> Control:
        """Surveyed points with measurements in pixels of the sensors' frames."""
        return control.model_copy(update={"points": tuple(self.sensor_point(point) for point in control.points)})

    def sensor_point(self, point: ControlPoint) -> ControlPoint:
        """A surveyed point with measurements in pixels of the sensors' frames."""
        return _with_marks(point, dict.fromkeys(self._rotated(point), self._to_sensor), self.photos)

    def upright_point(self, point: ControlPoint) -> ControlPoint:
        """A surveyed point of the sensors' frames with measurements in pixels of the upright photographs."""
        return _with_marks(point, dict.fromkeys(self._rotated(point), self._to_upright), self.photos)

    def _rotated(self, point: ControlPoint) -> list[str]:
        known = set(self.photos.names)
        return [name for name in point.measurements if name in known and self.flag(name) != 1]

    def _to_sensor(self, photo: Photo, pixels: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of the upright photograph to those of its sensor's frame."""
        return turned_pixels(pixels, QUARTER_TURNS[self.flag(photo.name)], (photo.width, photo.height))

    def _to_upright(self, photo: Photo, pixels: np.ndarray) -> np.ndarray:
        return turned_pixels(pixels, self.flag(photo.name), sensor_size(photo))

    def _sensor_poses(self, given: Mapping[str, ForeignPose] | None) -> Mapping[str, ForeignPose] | None:
        """Approximate orientations of the sensors' frames."""
        if given is None:
            return None
        back = {name: _about_axis(self.flag(name)).T if name in self.photos.names else np.eye(3) for name in given}
        return {name: replace(pose, rotation=back[name] @ pose.rotation) for name, pose in given.items()}

    def white_sigmas(self, white: Mapping[str, tuple[float, ...]], block: Block) -> dict[str, tuple[float, ...]]:
        """Standard errors of the sensors' interior parameters as those of the cameras of upright photographs."""
        # Quarter turns exchange parameters and change signs; absolute values exchange standard errors alike.
        return {
            name: tuple(map(float, np.abs(interior_turn(flag)) @ white[sensor]))
            for name, (sensor, flag) in sorted(self._sensors_of(block).items())
            if sensor in white
        }

    def _sensors_of(self, block: Block) -> dict[str, tuple[str, int]]:
        """Sensor and EXIF orientation by camera of upright photographs."""
        return {self._upright_camera(block, name): (block.of_photo[name], self.flag(name)) for name in block.names}

    def _upright_camera(self, block: Block, name: str) -> str:
        """The name of a photograph's camera; its own where its interior orientation varies from that of its camera."""
        upright = self.cameras.of_photo[name]
        return upright if block.of_photo[name] == self._sensor(name) else f"{upright}, {name}"

    def block(self, block: Block) -> Block:
        """A block in the frames of the sensors as a block of upright photographs."""
        turn = {photo.photo: _angle_turn(photo, self.flag(photo.photo)) for photo in block.photos}
        cameras = self._sensors_of(block)
        joint = {(j.first, j.second): np.array(j.covariance) for j in block.joint_cameras}
        joint |= {(second, first): covariance.T for (first, second), covariance in joint.items()}
        joint |= {(name, name): np.array(c.covariance) for name, c in block.cameras.items() if c.source == "block"}
        return block.model_copy(
            update={
                "cameras": {
                    name: turned(block.cameras[sensor], flag).model_copy(update={"name": name})
                    for name, (sensor, flag) in sorted(cameras.items())
                },
                "of_photo": {name: self._upright_camera(block, name) for name in block.of_photo},
                "photos": tuple(self._upright(photo, turn[photo.photo], cameras) for photo in block.photos),
                "joint": tuple(
                    j.model_copy(update={"covariance": _rows(turn[j.first] @ np.array(j.covariance) @ turn[j.second].T)})
                    for j in block.joint
                ),
                "joint_cameras": tuple(
                    JointCovariance(first=a, second=b, covariance=_rows(interior_turn(f) @ joint[s, t] @ interior_turn(g).T))
                    for (a, (s, f)), (b, (t, g)) in combinations(sorted(cameras.items()), 2)
                    if (s, t) in joint
                ),
            }
        )

    def _upright(self, photo: ExteriorOrientation, turn: np.ndarray, cameras: dict[str, tuple[str, int]]) -> ExteriorOrientation:
        rotation = _about_axis(self.flag(photo.photo)) @ rotation_matrix(*np.radians(photo.omega_phi_kappa))
        covariance = photo.covariance and _rows(turn @ np.array(photo.covariance) @ turn.T)
        own = {
            name: _rows(turn @ np.array(photo.with_interior[sensor]) @ interior_turn(flag).T)
            for name, (sensor, flag) in cameras.items()
            if sensor in photo.with_interior
        }
        degrees = tuple(float(v) for v in np.degrees(angles(rotation)))
        return photo.model_copy(update={"omega_phi_kappa": degrees, "covariance": covariance, "with_interior": own})

    def residuals(self, image: ImageResiduals) -> ImageResiduals:
        """Measurements and residuals in upright photographs."""
        pixels, away = np.column_stack([image.col, image.row]), np.column_stack([image.v_col, image.v_row])
        for number, photo in enumerate(self.sensor_photos().photos):
            own, flag = image.photo == number, self.flag(photo.name)
            if flag != 1 and own.any():
                pixels[own] = turned_pixels(pixels[own], flag, (photo.width, photo.height))
                away[own] = away[own] @ pixel_turn(flag).T
        return replace(image, col=pixels[:, 0], row=pixels[:, 1], v_col=away[:, 0], v_row=away[:, 1])

    def largest(self, row: LargestResidual) -> LargestResidual:
        """A residual along an axis of the sensor's frame as one along an axis of the upright photograph."""
        along = np.array(TURN[self.flag(row.photo)])[:, "xy".index(row.axis)]
        axis = int(np.abs(along).argmax())
        return row.model_copy(
            update={
                "axis": "xy"[axis],
                "residual_px": float(along[axis] * row.residual_px),
                "standardised": float(along[axis] * row.standardised),
            }
        )


def _about_axis(flag: int) -> np.ndarray:
    """(3, 3): from the image system of the sensor to that of the upright photograph."""
    out = np.eye(3)
    out[:2, :2] = TURN[flag]
    return out


def _with_marks(
    point: ControlPoint, turns: Mapping[str, Callable[[Photo, np.ndarray], np.ndarray]], photos: Photos
) -> ControlPoint:
    """The point with its measurements in photographs turned, in those that have a turn."""
    turned_marks = {
        name: (*map(float, turn(photos[name], np.array([point.measurements[name][:2]]))[0]), point.measurements[name][2])
        for name, turn in turns.items()
    }
    return point.model_copy(update={"measurements": {**point.measurements, **turned_marks}})


def _angle_turn(photo: ExteriorOrientation, flag: int) -> np.ndarray:
    """(6, 6): derivatives of X, Y, Z, omega, phi, kappa of the upright photograph by those of the sensor's frame."""
    out = np.eye(6)
    if flag != 1:
        # Through rotation vectors: angles of the two attitudes depend on each other in no simple way, rotation vectors linearly.
        sensor, turn = rotation_matrix(*np.radians(photo.omega_phi_kappa)), _about_axis(flag)
        out[3:, 3:] = angles_from_vector(turn @ sensor) @ turn @ np.linalg.inv(angles_from_vector(sensor))
    return out


def _rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in matrix)
