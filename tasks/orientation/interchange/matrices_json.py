"""Reads projection matrices in JSON, as many programs and data sets give them: photograph -> K, R, t (or centre), width, height.

K is in pixels with the centre of the upper left one at (0, 0); x_camera = R X + t with y down, looking along +z, as in computer
vision. Where no file of points comes along, the place where the viewing axes meet best tells the height of the object.
"""

import json
from typing import Any

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.tasks.orientation.interchange.foreign_block import Y_DOWN, ForeignBlock, ForeignPose

_ROTATIONS = ("R_world_to_camera", "R", "rotation")
_LENS = ("k1", "k2", "k3", "p1", "p2")
_ORTHOGONAL, _SQUARE = 1e-3, 2e-3
"""deviation of R R^T from unity, and relative difference of the two focal lengths, that are no mistake"""
_POINTS = 16
"""stand-ins for points of the object, so that the range of its heights has members"""


def read_matrices(text: str) -> ForeignBlock:
    """The block of the file. Raises WorkflowError that names the photograph and what is wrong with it."""
    try:
        entries = json.loads(text)
    except ValueError as error:
        raise WorkflowError(f"The file of matrices is no JSON ({error}); export it again.") from None
    if not isinstance(entries, dict) or not entries:
        raise WorkflowError('The file of matrices must be an object {"photograph": {"K": ..., "R": ..., "t": ...}, ...}.')
    poses, cameras = {}, {}
    for word, entry in entries.items():
        name = photo_stem(word)
        poses[name], cameras[name] = _pose(word, entry), _camera(name, word, entry)
    return ForeignBlock(poses, cameras, _object_points(poses))


def _numbers(word: str, entry: Any, names: tuple[str, ...], shape: tuple[int, ...]) -> np.ndarray | None:
    """The first of `names` that an entry has, of `shape`; None where it has none. Raises WorkflowError for another shape."""
    found = next((entry[name] for name in names if isinstance(entry, dict) and name in entry), None)
    if found is None:
        return None
    try:
        values = np.array(found, np.float64).reshape(shape)
    except (TypeError, ValueError):
        values = np.full(shape, np.nan)
    if not np.isfinite(values).all():
        raise WorkflowError(f"{names[0]} of {word} in the file of matrices is not {' x '.join(map(str, shape))} finite numbers.")
    return values


def _pose(word: str, entry: Any) -> ForeignPose:
    rotation = _numbers(word, entry, _ROTATIONS, (3, 3))
    t, centre = _numbers(word, entry, ("t",), (3,)), _numbers(word, entry, ("centre", "center"), (3,))
    if rotation is not None and centre is None and t is not None:
        centre = -rotation.T @ t
    if rotation is None or centre is None:
        raise WorkflowError(f"{word} in the file of matrices needs R_world_to_camera and t or centre.")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ORTHOGONAL or np.linalg.det(rotation) < 0:
        raise WorkflowError(f"R of {word} in the file of matrices is no rotation: its rows must be unit vectors, right-handed.")
    return ForeignPose(Y_DOWN @ rotation, centre)


def _camera(name: str, word: str, entry: Any) -> Camera:
    k, width, height = _numbers(word, entry, ("K",), (3, 3)), entry.get("width"), entry.get("height")
    if k is None or not (isinstance(width, int) and isinstance(height, int) and width > 0 and height > 0):
        raise WorkflowError(f"{word} in the file of matrices needs K (3 x 3), width and height in pixels.")
    c = 0.5 * (k[0, 0] + k[1, 1])
    if abs(k[0, 0] - k[1, 1]) > _SQUARE * c:
        raise WorkflowError(
            f"The focal lengths of {word}, {k[0, 0]:.1f} and {k[1, 1]:.1f} px, differ: pixels that are not square are not "
            "supported; resample the photographs."
        )
    lens = {name: float(entry[name]) for name in _LENS if name in entry}
    x0, y0 = k[0, 2] - (width - 1) / 2, (height - 1) / 2 - k[1, 2]
    return Camera(name=name, width=width, height=height, c=c, x0=x0, y0=y0, source="file", **lens)


def _object_points(poses: dict[str, ForeignPose]) -> np.ndarray:
    """Points (N, 3) about the place that is nearest to all viewing axes, as far apart in height as they pass beside it."""
    axes = np.array([-pose.rotation[2] for pose in poses.values()])
    centres = np.array([pose.centre for pose in poses.values()])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    normal = across.sum(axis=0)
    # Parallel axes meet nowhere: the object is then in front, as far away as the photographs are apart.
    if np.linalg.eigvalsh(normal)[0] < 1e-3 * len(poses):
        place = centres.mean(axis=0) + axes.mean(axis=0) * max(float(np.ptp(centres, axis=0).max()), 1.0)
    else:
        place = np.linalg.solve(normal, np.einsum("nij,nj->i", across, centres))
    apart = float(np.median(np.linalg.norm(np.einsum("nij,nj->ni", across, place - centres), axis=1)))
    spread = max(apart, 0.01 * float(np.median(np.linalg.norm(centres - place, axis=1))))
    return place + np.column_stack([np.zeros((_POINTS, 2)), np.linspace(-spread, spread, _POINTS)])
