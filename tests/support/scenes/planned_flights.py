"""Planned blocks to test with: layouts of known overlap, and the tags of a receiver."""

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.planned.planned_block import PlannedBlock

CAMERA = Camera(name="cam", width=4000, height=3000, c=3000.0, source="exif")
HEIGHT = 100.0
RTK, GPS = (0.02, 0.02, 0.03), (3.0, 3.0, 5.0)


def block(places: np.ndarray, headings: np.ndarray, sigma=GPS, pitch: float = 0.0, **given) -> PlannedBlock:
    """Photographs at `places` (n, 3) whose tops are turned to `headings` (n,), degrees anticlockwise from y."""
    lean = rotation_matrix(np.radians(pitch), 0.0, 0.0)
    known = {
        "centre": np.asarray(places, float),
        "rotation": np.array([lean @ rotation_matrix(0.0, 0.0, np.radians(h)) for h in headings]),
        "looks": np.ones(len(places), bool),
        "sigma": np.tile(sigma, (len(places), 1)),
        "common": np.full(len(places), sigma == GPS),
        "camera_of": np.zeros(len(places), int),
        "cameras": (CAMERA,),
        "origin": np.zeros(3),
        "ground": 0.0,
        "height_from": "relative",
    }
    return PlannedBlock(**{**known, **given})


def serpentine(strips: int, photos: int, forward: float = 0.7, side: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) and headings (n,) of strips to and fro along y, with these overlaps."""
    base, spacing = (1 - forward) * 3000 / 3000 * HEIGHT, (1 - side) * 4000 / 3000 * HEIGHT
    places, headings = [], []
    for strip in range(strips):
        along = np.arange(photos) * base
        along = along if strip % 2 == 0 else along[::-1]
        places += [(strip * spacing, y, HEIGHT) for y in along]
        headings += [0.0 if strip % 2 == 0 else 180.0] * photos
    return np.array(places), np.array(headings)


def turned(places: np.ndarray, degrees: float) -> np.ndarray:
    """The places turned about their middle."""
    turn = rotation_matrix(0.0, 0.0, np.radians(-degrees))[:2, :2]
    middle = places[:, :2].mean(axis=0)
    return np.column_stack([(places[:, :2] - middle) @ turn.T + middle, places[:, 2]])
