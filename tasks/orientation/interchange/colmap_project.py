"""A folder that COLMAP's dense matching starts from: sparse model as text and binary, lists of photographs for its stereo.

Source: COLMAP's documentation, "Output format" (text and binary) and "Dense reconstruction"; pixels there have their origin at the
corner of the upper left pixel.
"""

import struct
from itertools import pairwise

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.survey_files.noted_origin import NotedOrigin, origin_note
from orthomill.tasks.geometry.distortion import principal_place
from orthomill.tasks.geometry.rotation_quaternion import quaternion
from orthomill.tasks.orientation.interchange.pinhole_model import PinholeModel, file_of

_CORNER = 0.5
"""px from the corner of a pixel to its centre"""
_PINHOLE = 1
"""number of the camera model: fx, fy, cx, cy"""
_GREY = (128, 128, 128)


def colmap_project(model: PinholeModel, suffix: str, crs: str) -> dict[str, bytes]:
    """Contents by path. `suffix`: of the undistorted photographs, which lie in images/."""
    files = [file_of(name, suffix) for name in model.names]
    note = origin_note(NotedOrigin(tuple(model.origin.tolist()), crs))
    return {
        "sparse/cameras.bin": _binary_cameras(model),
        "sparse/images.bin": _binary_images(model, files),
        "sparse/points3D.bin": _binary_points(model),
        "text/cameras.txt": _text_cameras(model).encode(),
        "text/images.txt": (note + _text_images(model, files)).encode(),
        "text/points3D.txt": (note + _text_points(model)).encode(),
        "stereo/patch-match.cfg": "".join(f"{file}\n__auto__, 20\n" for file in files).encode(),
        "stereo/fusion.cfg": "".join(f"{file}\n" for file in files).encode(),
        "origin.txt": note.removeprefix("# ").encode(),
    }


def _constants(camera: Camera) -> tuple[float, float, float, float]:
    col, row = principal_place(camera)
    return camera.c, camera.c, col + _CORNER, row + _CORNER


def _pose(model: PinholeModel, k: int) -> tuple[list[float], list[float]]:
    """Quaternion (w, x, y, z) and translation of a photograph."""
    turn = model.rotations[k]
    return [float(v) for v in quaternion(turn)], [float(v) for v in -turn @ model.centres[k]]


def _measured(model: PinholeModel, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) and numbers (n,) of the points of a photograph, counted from 1."""
    own = model.ray_photo == k
    return model.ray_pixel[own] + _CORNER, model.ray_point[own] + 1


def _tracks(model: PinholeModel) -> list[tuple[np.ndarray, np.ndarray]]:
    """For every point, the photographs that measured it, counted from 1, and which of their own measurements it is, from 0."""
    within = np.empty(len(model.ray_photo), np.int64)
    for k in range(len(model.names)):
        own = model.ray_photo == k
        within[own] = np.arange(own.sum())
    ends = np.searchsorted(model.ray_point, np.arange(len(model.points) + 1))
    return [(model.ray_photo[a:b] + 1, within[a:b]) for a, b in pairwise(ends)]


def _binary_cameras(model: PinholeModel) -> bytes:
    rows = (struct.pack("<iiQQ4d", k, _PINHOLE, c.width, c.height, *_constants(c)) for k, c in enumerate(model.cameras, 1))
    return struct.pack("<Q", len(model.cameras)) + b"".join(rows)


def _binary_images(model: PinholeModel, files: list[str]) -> bytes:
    out = [struct.pack("<Q", len(files))]
    for k, file in enumerate(files):
        turn, shift = _pose(model, k)
        pixels, points = _measured(model, k)
        out.append(struct.pack("<i7di", k + 1, *turn, *shift, int(model.camera[k]) + 1) + file.encode() + b"\0")
        table = np.empty(len(points), [("xy", "<f8", 2), ("point", "<i8")])
        table["xy"], table["point"] = pixels, points
        out.append(struct.pack("<Q", len(points)) + table.tobytes())
    return b"".join(out)


def _binary_points(model: PinholeModel) -> bytes:
    out = [struct.pack("<Q", len(model.points))]
    for k, (photos, within) in enumerate(_tracks(model)):
        head = struct.pack("<Q3d3BdQ", k + 1, *model.points[k], *_GREY, model.errors[k], len(photos))
        out.append(head + np.column_stack([photos, within]).astype("<i4").tobytes())
    return b"".join(out)


def _text_cameras(model: PinholeModel) -> str:
    lines = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"]
    for k, c in enumerate(model.cameras, 1):
        lines.append(f"{k} PINHOLE {c.width} {c.height} {' '.join(repr(float(v)) for v in _constants(c))}\n")
    return "".join(lines)


def _text_images(model: PinholeModel, files: list[str]) -> str:
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n"]
    for k, file in enumerate(files):
        turn, shift = _pose(model, k)
        lines.append(f"{k + 1} {' '.join(map(repr, turn + shift))} {model.camera[k] + 1} {file}\n")
        lines.append(" ".join(f"{x:.4f} {y:.4f} {p}" for (x, y), p in zip(*_measured(model, k), strict=True)) + "\n")
    return "".join(lines)


def _text_points(model: PinholeModel) -> str:
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"]
    for k, (photos, within) in enumerate(_tracks(model)):
        x, y, z = model.points[k]
        track = " ".join(f"{photo} {own}" for photo, own in zip(photos, within, strict=True))
        lines.append(f"{k + 1} {x:.4f} {y:.4f} {z:.4f} 128 128 128 {model.errors[k]:.4f} {track}\n")
    return "".join(lines)
