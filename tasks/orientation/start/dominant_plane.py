"""The plane that a block without datum stands on: the ground round an object, the floor of an excavation, a facade."""

import numpy as np

NEAR = 0.05
"""Distance from the plane, as a share of the median one from the middle of all points, up to which a point belongs to it"""
LEAST_SHARE = 0.25
"""Share of the points that a plane must have: the ground round an object has fewer of them than the object. Of points that fill a
volume a twentieth is as near to any plane."""
STEEPEST = 65.0
"""degrees between the viewing direction and the plane's normal, beyond which the plane is seen in passing"""
ALONG = np.sin(np.radians(12.0))
"""Rows of photographs run along the ground as along a facade, but not along the side wall of one: median sine of their angles"""
_TRIALS, _MOST_POINTS = 400, 4000
_ROUNDS = 10


def dominant_plane(points: np.ndarray, towards: np.ndarray, rows: np.ndarray) -> np.ndarray | None:
    """The unit normal (3,) of the plane that most of `points` (N, 3) lie near and rows run along; None where there is none.

    `towards` (3,) is the mean direction to the cameras, on whose side the normal is, `rows` (P, 3) unit vectors along the rows of
    the photographs. Trials are seeded: the same points give the same plane.
    """
    if len(points) < 10:
        return None
    few = points[:: -(-len(points) // _MOST_POINTS)]
    near = NEAR * float(np.median(np.linalg.norm(few - np.median(few, axis=0), axis=1)))
    corners = few[np.random.default_rng(20).integers(0, len(few), (_TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    best, most = None, 0
    for corner, normal in zip(corners[:, 0], normals, strict=True):
        if _is_photographed(normal, towards, rows):
            count = int((np.abs((few - corner) @ normal) < near).sum())
            best, most = ((corner, normal), count) if count > most else (best, most)
    if best is None or most < LEAST_SHARE * len(few):
        return None
    normal = _fitted(few, *best, near)
    normal = normal if normal @ towards > 0 else -normal
    return normal if _is_photographed(normal, towards, rows) else None


def _is_photographed(normal: np.ndarray, towards: np.ndarray, rows: np.ndarray) -> bool:
    """Whether a plane is what the photographs show, and not what they see in passing."""
    return bool(abs(normal @ towards) >= np.cos(np.radians(STEEPEST)) and np.median(np.abs(rows @ normal)) <= ALONG)


def _fitted(points: np.ndarray, on: np.ndarray, normal: np.ndarray, near: float) -> np.ndarray:
    """The normal of the plane that fits the points near it best; which these are is found again with every fit."""
    for _ in range(_ROUNDS):
        mine = points[np.abs((points - on) @ normal) < near]
        on = mine.mean(axis=0)
        normal = np.linalg.svd(mine - on, full_matrices=False)[2][2]
    return np.asarray(normal)
