"""OpenSfM's reconstruction.json, which OpenDroneMap and WebODM leave behind as opensfm/reconstruction.json.

Lengths in the image are divided by the longer side of the photograph, measured from its centre, y down; the camera looks along +z;
a rotation vector and a translation take the topocentric world (east, north, up about `reference_lla`) to the camera. Distortion is
OpenCV's. Source: OpenSfM's documentation, "Geometric models" and "Dataset structure".
"""

import json
from typing import Any

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.block_findings import BlockFinding, CameraConstantsAveraged, LargestReconstruction
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector, vector_of_rotation
from orthomill.tasks.geometry.topocentric import Reference, Topocentric, reference_of
from orthomill.tasks.orientation.interchange.foreign_block import Y_DOWN, ForeignBlock, ForeignPose, photo_name

_MODELS = {
    "perspective": ("focal", "focal", ("k1", "k2")),
    "simple_radial": ("focal_x", "focal_y", ("k1",)),
    "radial": ("focal_x", "focal_y", ("k1", "k2")),
    "brown": ("focal_x", "focal_y", ("k1", "k2", "k3", "p1", "p2")),
}


def read_opensfm(text: str, crs: str, reference: str | None = None) -> ForeignBlock:
    """The largest reconstruction of the file as a block in the map of `crs`; `reference`: the text of reference_lla.json, where the
    reconstruction does not hold it. Raises WorkflowError."""
    try:
        parts = json.loads(text)
        part = max(parts, key=lambda one: len(one["shots"]))
        cameras = {name: _camera(name, values) for name, values in part["cameras"].items()}
        place = json.loads(reference) if reference else part.get("reference_lla")
        poses = {photo_name(name): _pose(shot) for name, shot in part["shots"].items()}
        of_photo = {photo_name(name): cameras[shot["camera"]][0] for name, shot in part["shots"].items()}
        points = np.array([point["coordinates"] for point in part.get("points", {}).values()], float).reshape(-1, 3)
    except (json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
        raise WorkflowError(
            f"This is not a reconstruction.json of OpenSfM or OpenDroneMap ({type(error).__name__}: {error}); it must be a list of "
            "reconstructions with cameras and shots."
        ) from error
    if not place:
        raise WorkflowError(
            "The reconstruction does not say where on earth it lies (reference_lla); name OpenSfM's reference_lla.json as well."
        )
    findings: list[BlockFinding] = [finding for _, finding in cameras.values() if finding]
    if len(parts) > 1:
        findings.append(LargestReconstruction(count=len(parts), photos=len(part["shots"])))
    return _on_map(ForeignBlock(poses, of_photo, points, None, tuple(findings)), _reference(place), crs)


def _reference(place: dict[str, float]) -> Reference:
    return Reference(float(place["latitude"]), float(place["longitude"]), float(place["altitude"]))


def _pose(shot: dict[str, Any]) -> ForeignPose:
    rotation = rotation_of_vector(np.array(shot["rotation"], float))
    return ForeignPose(Y_DOWN @ rotation, -rotation.T @ np.array(shot["translation"], float))


def _camera(name: str, values: dict[str, Any]) -> tuple[Camera, CameraConstantsAveraged | None]:
    """The camera, and what it loses on the way."""
    kind = values["projection_type"]
    if kind not in _MODELS:
        raise WorkflowError(f"The camera {name} is {kind}; cameras that can be read are {', '.join(_MODELS)}.")
    fx, fy, lens = _MODELS[kind]
    longer = max(values["width"], values["height"])
    x, y = values[fx], values[fy]
    camera = Camera(
        name=name, width=values["width"], height=values["height"], c=0.5 * (x + y) * longer, source="file",
        x0=values.get("c_x", 0.0) * longer, y0=-values.get("c_y", 0.0) * longer, **{k: values.get(k, 0.0) for k in lens},
    )  # fmt: skip
    off = 0.25 * abs(x - y) * longer / max(x, y)
    lost = CameraConstantsAveraged(camera=name, x_px=x * longer, y_px=y * longer, error_px=off)
    return camera, lost if off > 0.01 else None


def _on_map(block: ForeignBlock, reference: Reference, crs: str) -> ForeignBlock:
    """From east, north, up to the map."""
    frame = Topocentric(reference, crs)
    poses = {
        name: ForeignPose(pose.rotation @ frame.turn(pose.centre).T, frame.to_map(pose.centre[None])[0])
        for name, pose in block.poses.items()
    }
    return ForeignBlock(poses, block.cameras, frame.to_map(block.points), block.error_px, block.findings)


def write_opensfm(block: ForeignBlock, files: dict[str, str], crs: str) -> str:
    """The block as reconstruction.json; `files`: photograph -> file name."""
    centre = np.mean([pose.centre for pose in block.poses.values()], axis=0)
    reference = reference_of(crs, np.array([centre[0], centre[1], 0.0]))
    frame = Topocentric(reference, crs)
    shots = {files[name]: _shot(pose, block.cameras[name].name, frame) for name, pose in block.poses.items()}
    points = {
        str(i): {"color": [128.0, 128.0, 128.0], "coordinates": xyz} for i, xyz in enumerate(frame.from_map(block.points).tolist())
    }
    place = {"latitude": reference.latitude, "longitude": reference.longitude, "altitude": reference.altitude}
    cameras = {camera.name: _camera_values(camera) for camera in block.cameras.values()}
    return json.dumps([{"cameras": cameras, "shots": shots, "points": points, "reference_lla": place}], indent=1)


def _shot(pose: ForeignPose, camera: str, frame: Topocentric) -> dict[str, Any]:
    centre = frame.from_map(pose.centre[None])[0]
    rotation = Y_DOWN @ pose.rotation @ frame.turn(centre)
    translation = -rotation @ centre
    return {
        "rotation": vector_of_rotation(rotation).tolist(), "translation": translation.tolist(), "camera": camera,
        "orientation": 1, "capture_time": 0.0, "gps_dop": 0.0, "gps_position": centre.tolist(), "vertices": [], "faces": [],
        "scale": 1.0, "covariance": [], "merge_cc": 0,
    }  # fmt: skip


def _camera_values(camera: Camera) -> dict[str, Any]:
    longer = max(camera.width, camera.height)
    return {
        "projection_type": "brown", "width": camera.width, "height": camera.height,
        "focal_x": camera.c / longer, "focal_y": camera.c / longer, "c_x": camera.x0 / longer, "c_y": -camera.y0 / longer,
        "k1": camera.k1, "k2": camera.k2, "p1": camera.p1, "p2": camera.p2, "k3": camera.k3,
    }  # fmt: skip
