"""A scene of OpenMVS, in the interface that it reads from other programs.

Numbers are little endian, lengths of texts and lists 64 bits, matrices by rows. Pixels have their centres at integers, as here;
cameras look along z with y down. Points are stored in single precision, less the origin.
Source: OpenMVS, libs/MVS/Interface.h, version 2 of the interface, which all later versions read.
"""

import struct
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from orthomill.tasks.geometry.distortion import principal_place
from orthomill.tasks.orientation.interchange.pinhole_model import PinholeModel, file_of

_VERSION = 2
_HEAD = struct.pack("<4sII", b"MVSI", _VERSION, 0)


def openmvs_scene(model: PinholeModel, suffix: str) -> bytes:
    """The file scene.mvs; its photographs lie in images/ beside it."""
    # A platform for each camera, with a pose for each of its photographs.
    members = [np.flatnonzero(model.camera == k) for k in range(len(model.cameras))]
    pose = {int(k): at for own in members for at, k in enumerate(own)}
    images = (
        _text(f"images/{file_of(name, suffix)}") + struct.pack("<3I", int(model.camera[k]), 0, pose[k])
        for k, name in enumerate(model.names)
    )
    empty = _list([])
    return b"".join(
        [
            _HEAD,
            _list(_platform(model, k, own) for k, own in enumerate(members)),
            _list(images),
            _list(_vertices(model)),
            # Normals and colours of points; lines, their normals and colours.
            *[empty] * 5,
            np.eye(4).astype("<f8").tobytes(),
        ]
    )


def _platform(model: PinholeModel, number: int, own: np.ndarray) -> bytes:
    camera = model.cameras[number]
    col, row = principal_place(camera)
    calibration = np.array([[camera.c, 0, col], [0, camera.c, row], [0, 0, 1]])
    inner = _text(camera.name) + struct.pack("<2I", camera.width, camera.height) + _doubles(calibration, np.eye(3), np.zeros(3))
    poses = (_doubles(model.rotations[k], model.centres[k]) for k in own)
    return _text(camera.name) + _list([inner]) + _list(poses)


def _vertices(model: PinholeModel) -> list[bytes]:
    ends = np.searchsorted(model.ray_point, np.arange(len(model.points) + 1))
    views = np.empty(len(model.ray_photo), [("image", "<u4"), ("confidence", "<f4")])
    views["image"], views["confidence"] = model.ray_photo, 0.0
    places = model.points.astype("<f4")
    return [places[k].tobytes() + struct.pack("<Q", b - a) + views[a:b].tobytes() for k, (a, b) in enumerate(pairwise(ends))]


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<Q", len(data)) + data


def _list(items: Iterable[bytes]) -> bytes:
    parts = list(items)
    return struct.pack("<Q", len(parts)) + b"".join(parts)


def _doubles(*arrays: np.ndarray) -> bytes:
    return b"".join(np.ascontiguousarray(array, "<f8").tobytes() for array in arrays)
