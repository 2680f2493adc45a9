"""What OpenDroneMap and WebODM read and write of a block: shots.geojson, cameras.json, geo.txt, gcp_list.txt, check_list.txt,
ground_control_points.geojson.

Rotations are vectors from the axes of the map to a camera that looks along z with y down; photographs are those of their files.
Source: OpenDroneMap, opendm/shots.py, and its documentation ("Image geolocation files", "Ground control points").
"""

import json
from datetime import UTC, datetime
from typing import Any

import numpy as np
from pyproj import CRS, Transformer

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.camera_change import TURN
from orthomill.tasks.geometry.intersection import intersect_rays
from orthomill.tasks.geometry.reference_system import ground_crs, on_earth
from orthomill.tasks.geometry.rotation_vector import vector_of_rotation
from orthomill.tasks.geometry.view import View
from orthomill.tasks.orientation.interchange.foreign_block import Y_DOWN, ForeignBlock
from orthomill.tasks.orientation.interchange.opensfm import camera_values


def odm_files(block: ForeignBlock, files: dict[str, str], control: Control, photos: Photos, crs: str) -> dict[str, bytes]:
    """Contents by file name; `files`: photograph -> file name. Raises WorkflowError for a block that lies nowhere on the earth, and
    for lenses that OpenDroneMap lacks."""
    if not on_earth(crs):
        raise WorkflowError(
            "OpenDroneMap needs a place on the earth, and this block has none: give the project positions or control."
        )
    texts = {
        "shots.geojson": _shots(block, files, photos, crs),
        "cameras.json": _cameras(block),
        "geo.txt": _places(block, files, crs),
    }
    # Check points in a list of their own: whatever stands in gcp_list.txt takes part there.
    for role, name in (("control", "gcp_list.txt"), ("check", "check_list.txt")):
        if rows := _marks(control, role, files, photos):
            texts[name] = "\n".join([_code(crs), *rows]) + "\n"
    if measured := _measured_control(block, files, control, photos, crs):
        texts["ground_control_points.geojson"] = measured
    return {name: text.encode() for name, text in texts.items()}


def _code(crs: str) -> str:
    """The plan system as these files name it: a code, or the words of PROJ."""
    plan = CRS.from_user_input(crs)
    plan = plan.sub_crs_list[0] if plan.is_compound else plan.to_2d()
    authority = plan.to_authority()
    return ":".join(authority) if authority else plan.to_proj4()


def _shots(block: ForeignBlock, files: dict[str, str], photos: Photos, crs: str) -> str:
    to_degrees = Transformer.from_crs(ground_crs(crs), CRS.from_epsg(4326), always_xy=True)
    features = []
    for name, pose in block.poses.items():
        camera = block.cameras[name]
        x, y, z = pose.centre.tolist()
        known = {
            "filename": files[name],
            "camera": camera.name,
            "focal": camera.c / max(camera.width, camera.height),
            "width": camera.width,
            "height": camera.height,
            "translation": [x, y, z],
            "rotation": vector_of_rotation(Y_DOWN @ pose.rotation).tolist(),
        }
        if moment := photos[name].time:
            # Seconds since 1970, as OpenSfM has them: a clock without a zone counts as UTC.
            known["capture_time"] = datetime.fromisoformat(moment).replace(tzinfo=UTC).timestamp()
        place = {"type": "Point", "coordinates": [*to_degrees.transform(x, y), z]}
        features.append({"type": "Feature", "properties": known, "geometry": place})
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1)


def _measured_control(block: ForeignBlock, files: dict[str, str], control: Control, photos: Photos, crs: str) -> str:
    """Control and check points with the place of each in the photographs, marked and by the block, in units of the longer side from
    the middle; `error`: the intersection of its marks in the block minus its coordinates, m. Empty without such points."""
    to_degrees = Transformer.from_crs(ground_crs(crs), CRS.from_epsg(4326), always_xy=True)
    features = []
    for point in control.points:
        seen = [name for name in point.measurements if name in files]
        if point.role == "tie" or len(seen) < 2:
            continue
        views = [View(name, block.cameras[name], block.poses[name].rotation, block.poses[name].centre) for name in seen]
        pixels = [np.array([_in_file(photos, name, *point.measurements[name][:2])]) for name in seen]
        rays = np.stack([view.rays(pixel) for view, pixel in zip(views, pixels, strict=True)])
        place = intersect_rays(np.stack([view.centre[None] for view in views]), rays)[0]
        if not np.isfinite(place).all():
            continue
        seen_at = [
            {
                "shot_id": files[view.name],
                "annotated": _normalised(view.camera, pixel[0]),
                "reprojected": _normalised(view.camera, view.project(place)[0]),
            }
            for view, pixel in zip(views, pixels, strict=True)
        ]
        known = {"id": point.name, "role": point.role, "observations": seen_at, "error": (place[0] - point.xyz).tolist()}
        x, y, z = point.xyz
        geometry = {"type": "Point", "coordinates": [*to_degrees.transform(x, y), z]}
        features.append({"type": "Feature", "properties": known, "geometry": geometry})
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1) if features else ""


def _normalised(camera: Camera, pixel: np.ndarray) -> list[float]:
    """A pixel (col, row) from the middle of the photograph, in units of its longer side."""
    middle = (np.array([camera.width, camera.height]) - 1) / 2
    return ((pixel - middle) / max(camera.width, camera.height)).tolist()


def _cameras(block: ForeignBlock) -> str:
    cameras: dict[str, dict[str, Any]] = {}
    for camera in block.cameras.values():
        cameras[camera.name] = camera_values(camera)
        if cameras[camera.name]["projection_type"] == "unknown":
            raise WorkflowError(
                f"OpenDroneMap has no lens of the kind {camera.lens.kind} of the camera {camera.name}; export undistorted "
                "photographs (--as colmap)."
            )
    return json.dumps(cameras, indent=1)


def _places(block: ForeignBlock, files: dict[str, str], crs: str) -> str:
    rows = [f"{files[name]} {x:.4f} {y:.4f} {z:.4f}" for name, pose in block.poses.items() for x, y, z in [pose.centre]]
    return "\n".join([_code(crs), *rows]) + "\n"


def _marks(control: Control, role: str, files: dict[str, str], photos: Photos) -> list[str]:
    rows = []
    for point in control.points:
        if point.role != role:
            continue
        x, y, z = point.xyz
        for name, (col, row, _) in point.measurements.items():
            if name in files:
                at, down = _in_file(photos, name, col, row)
                rows.append(f"{x:.4f} {y:.4f} {z:.4f} {at:.3f} {down:.3f} {files[name]} {point.name}")
    return rows


def _in_file(photos: Photos, name: str, col: float, row: float) -> tuple[float, float]:
    """A pixel of the upright photograph in the file as it is stored."""
    photo = photos[name]
    turn = np.array(TURN[photo.exif_orientation])
    x, y = turn.T @ (col - (photo.width - 1) / 2, (photo.height - 1) / 2 - row)
    width, height = (photo.height, photo.width) if photo.exif_orientation >= 5 else (photo.width, photo.height)
    return x + (width - 1) / 2, (height - 1) / 2 - y
