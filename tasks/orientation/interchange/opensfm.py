"""OpenSfM's reconstruction.json, which OpenDroneMap and WebODM leave behind as opensfm/reconstruction.json.

Image coordinates are in units of the longer side of the photograph, from its centre, y down; the camera looks along +z; a rotation
vector and a translation transform the topocentric system (east, north, up about `reference_lla`) to the camera. Distortion is
OpenCV's. Source: OpenSfM's documentation, "Geometric models" and "Dataset structure".
"""

import json
from dataclasses import asdict
from typing import Any

import numpy as np
from pydantic_core import to_json

from orthomill.schemas.camera import LENSES, Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.foreign_findings import LargestReconstruction
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.tasks.geometry.reference_system import on_earth
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector, vector_of_rotation
from orthomill.tasks.geometry.topocentric import Reference, Topocentric, reference_of
from orthomill.tasks.orientation.interchange.foreign_block import Y_DOWN, ForeignBlock, ForeignPose

# Names of the two camera constants, and the distortion coefficients, by projection type.
_MODELS = {
    "perspective": ("focal", "focal", ("k1", "k2")),
    "simple_radial": ("focal_x", "focal_y", ("k1",)),
    "radial": ("focal_x", "focal_y", ("k1", "k2")),
    "brown": ("focal_x", "focal_y", ("k1", "k2", "k3", "p1", "p2")),
    "fisheye_opencv": ("focal_x", "focal_y", ("k1", "k2", "k3", "k4")),
}


def read_opensfm(text: str, crs: str, reference: str | None = None) -> ForeignBlock:
    """The largest reconstruction of the file as a block in the map of `crs`; `reference`: the text of reference_lla.json, where the
    reconstruction does not hold it. Raises WorkflowError."""
    try:
        # OpenSfM splits a block that is not connected; the parts have unrelated systems.
        parts = json.loads(text)
        part = max(parts, key=lambda one: len(one["shots"]))
        cameras = {name: _camera(name, values) for name, values in part["cameras"].items()}
        place = json.loads(reference) if reference else part.get("reference_lla")
        poses = {photo_stem(name): _pose(shot) for name, shot in part["shots"].items()}
        of_photo = {photo_stem(name): cameras[shot["camera"]] for name, shot in part["shots"].items()}
        points = np.array([point["coordinates"] for point in part.get("points", {}).values()], float).reshape(-1, 3)
    except (json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
        # Any of these errors means another kind of JSON; the message says which key or type was missing.
        raise WorkflowError(
            f"This is not a reconstruction.json of OpenSfM or OpenDroneMap ({type(error).__name__}: {error}); it must be a list of "
            "reconstructions with cameras and shots."
        ) from error
    if not place:
        raise WorkflowError(
            "The reconstruction holds no reference point (reference_lla); name OpenSfM's reference_lla.json as well."
        )
    findings: list[BlockFinding] = []
    if len(parts) > 1:
        findings.append(LargestReconstruction(count=len(parts), photos=len(part["shots"])))
    return _on_map(ForeignBlock(poses, of_photo, points, None, tuple(findings)), _reference(place), crs)


def _reference(place: dict[str, float]) -> Reference:
    return Reference(float(place["latitude"]), float(place["longitude"]), float(place["altitude"]))


def _pose(shot: dict[str, Any]) -> ForeignPose:
    """The pose of a shot in topocentric coordinates."""
    rotation = rotation_of_vector(np.array(shot["rotation"], float))
    return ForeignPose(Y_DOWN @ rotation, -rotation.T @ np.array(shot["translation"], float))


def _camera(name: str, values: dict[str, Any]) -> Camera:
    kind = values["projection_type"]
    if kind not in _MODELS:
        raise WorkflowError(f"The camera {name} is {kind}; cameras that can be read are {', '.join(_MODELS)}.")
    fx, fy, lens = _MODELS[kind]
    longer = max(values["width"], values["height"])
    x, y = values[fx], values[fy]
    camera = Camera(
        name=name,
        width=values["width"],
        height=values["height"],
        c=y * longer,
        lens=LENSES["fisheye" if kind == "fisheye_opencv" else "brown"](),
        source="file",
        x0=values.get("c_x", 0.0) * longer,
        y0=-values.get("c_y", 0.0) * longer,
    )
    return camera.changed(affinity=x / y - 1.0, **{k: values.get(k, 0.0) for k in lens})


def _on_map(block: ForeignBlock, reference: Reference, crs: str) -> ForeignBlock:
    """From topocentric coordinates to the map, with each camera's axes rotated by the convergence and curvature at its place."""
    frame = Topocentric(reference, crs)
    poses = {
        name: ForeignPose(pose.rotation @ frame.turn(pose.centre).T, frame.to_map(pose.centre[None])[0])
        for name, pose in block.poses.items()
    }
    return ForeignBlock(poses, block.cameras, frame.to_map(block.points), block.error_px, block.findings)


def write_opensfm(block: ForeignBlock, files: dict[str, str], crs: str) -> str:
    """The block as reconstruction.json; `files`: photograph -> file name."""
    # In the middle of the block, where the tangent plane fits best; at height 0, so that heights keep their values.
    centre = np.mean([pose.centre for pose in block.poses.values()], axis=0)
    reference = reference_of(crs, np.array([centre[0], centre[1], 0.0])) if on_earth(crs) else None
    frame = Topocentric(reference, crs) if reference else _Unplaced()
    shots = {files[name]: _shot(pose, block.cameras[name].name, frame) for name, pose in block.poses.items()}
    points = {
        str(i): {"color": [128.0, 128.0, 128.0], "coordinates": xyz} for i, xyz in enumerate(frame.from_map(block.points).tolist())
    }
    place = {"reference_lla": asdict(reference)} if reference else {}
    cameras = {camera.name: camera_values(camera) for camera in block.cameras.values()}
    # Half a million points: Python's own encoder takes ten times as long as soon as it indents.
    return to_json([{"cameras": cameras, "shots": shots, "points": points, **place}], indent=1).decode()


class _Unplaced:
    """The frame of a block that lies nowhere on the earth: its coordinates as they are."""

    def from_map(self, points: np.ndarray) -> np.ndarray:
        return points

    def turn(self, _point: np.ndarray) -> np.ndarray:
        return np.eye(3)


def _shot(pose: ForeignPose, camera: str, frame: Topocentric | _Unplaced) -> dict[str, Any]:
    """A shot of OpenSfM; fields that it needs but that say nothing here have its own defaults."""
    centre = frame.from_map(pose.centre[None])[0]
    rotation = Y_DOWN @ pose.rotation @ frame.turn(centre)
    translation = -rotation @ centre
    return {
        "rotation": vector_of_rotation(rotation).tolist(),
        "translation": translation.tolist(),
        "camera": camera,
        # Poses leave for files as stored, without an EXIF orientation.
        "orientation": 1,
        "capture_time": 0.0,
        "gps_dop": 0.0,
        "gps_position": centre.tolist(),
        "vertices": [],
        "faces": [],
        "scale": 1.0,
        "covariance": [],
        "merge_cc": 0,
    }


def camera_values(camera: Camera) -> dict[str, Any]:
    """A camera as OpenSfM and OpenDroneMap have it; with the projection "unknown" where they lack its lens."""
    longer = max(camera.width, camera.height)
    projection = {"brown": "brown", "fisheye": "fisheye_opencv"}.get(camera.lens.kind)
    if projection is None:
        # Coefficients of one model in another would be a camera that looks right and is not.
        return {"projection_type": "unknown", "width": camera.width, "height": camera.height, "lens": camera.lens.model_dump()}
    return {
        "projection_type": projection,
        "width": camera.width,
        "height": camera.height,
        "focal_x": camera.c * (1.0 + camera.affinity) / longer,
        "focal_y": camera.c / longer,
        "c_x": camera.x0 / longer,
        "c_y": -camera.y0 / longer,
        **{name: camera.value(name) for name in _MODELS[projection][2]},
    }
