"""What is flown over: layouts of photographs, and the ground below them. Lengths follow the flying height.

A layout places the photographs; the camera, the ground and what is known of both come from elsewhere.
"""

from collections.abc import Callable

import numpy as np

from benchmarks.orientation.simulated_scenes import photographed_layouts
from orthomill.schemas.camera import Camera
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

Scene = photographed_layouts.Scene
ORIGIN = np.array([407000.0, 4357000.0, 100.0])
FORWARD, SIDE = 0.17, 0.30
"""Base along and between strips, in units of the flying height: overlaps of 74 and 63 % for the camera whose c is 1.22 widths."""
RELIEF = {"flat": 0.002, "rolling": 0.03, "rough": 0.12}
"""Root mean square relief in units of the flying height."""
POINTS_PER_FRAME = 900
"""Ground points in the area of one photograph."""

Placed = list[tuple[np.ndarray, np.ndarray]]
"""Projection centre (3,) and rotation (3, 3) of every photograph, the ground below at 0."""


def _down(rng: np.random.Generator, places: np.ndarray, heading: float, pitch: float = 0.0) -> Placed:
    """Photographs at `places` (n, 3) whose top is turned to `heading`, `pitch` degrees off the vertical towards it."""
    placed = []
    for place in places:
        lean, roll = np.radians(pitch) + rng.normal(0, 0.02), rng.normal(0, 0.02)
        turn = np.radians(heading + rng.normal(0, 2))
        # First up from the vertical in the camera's own system, then to the heading.
        placed.append(
            (place + rng.normal(0, 0.01, 3) * place[2], rotation_matrix(lean, roll, 0.0) @ rotation_matrix(0.0, 0.0, turn))
        )
    return placed


def _strips(height: float, strips: int, photos: int, forward: float = FORWARD) -> list[np.ndarray]:
    """Strips along x, centred at 0, each `photos` places (n, 3)."""
    along = forward * (np.arange(photos) - (photos - 1) / 2)
    across = SIDE * (np.arange(strips) - (strips - 1) / 2)
    return [height * np.column_stack([along, np.full(photos, y), np.ones(photos)]) for y in across]


def _flown(rng: np.random.Generator, strips: list[np.ndarray], pitch: float = 0.0) -> Placed:
    """Strips flown to and fro."""
    return [one for i, strip in enumerate(strips) for one in _down(rng, strip, -90.0 if i % 2 == 0 else 90.0, pitch)]


def grid(rng: np.random.Generator, height: float) -> Placed:
    """Parallel strips of vertical photographs."""
    return _flown(rng, _strips(height, int(rng.integers(3, 6)), int(rng.integers(7, 10))))


def crossed(rng: np.random.Generator, height: float) -> Placed:
    """A grid with two cross strips a fifth higher."""
    placed = _flown(rng, _strips(height, 4, 8))
    cross = [
        strip[:, [1, 0, 2]] * [1.0, 1.0, 1.2] + [side * 0.4 * height, 0, 0] for side in (-1, 1) for strip in _strips(height, 1, 6)
    ]
    return placed + [one for i, strip in enumerate(cross) for one in _down(rng, strip, 180.0 * i)]


def oblique(rng: np.random.Generator, height: float) -> Placed:
    """Two grids at right angles, the camera tilted by 25 degrees."""
    strips = _strips(height, 3, 6)
    return _flown(rng, strips, 25.0) + [
        one for i, strip in enumerate(strips) for one in _down(rng, strip[:, [1, 0, 2]], 180.0 * (i % 2), 25.0)
    ]


def corridor(rng: np.random.Generator, height: float) -> Placed:
    """One to three long strips."""
    strips = int(rng.integers(1, 4))
    return _flown(rng, _strips(height, strips, {1: 24, 2: 16, 3: 14}[strips]))


def circle(rng: np.random.Generator, height: float) -> Placed:
    """A circle that looks inwards."""
    photos = int(rng.integers(24, 37))
    placed = []
    for angle in np.degrees(2 * np.pi * np.arange(photos) / photos):
        place = height * np.array([[0.7 * np.cos(np.radians(angle)), 0.7 * np.sin(np.radians(angle)), 1.0]])
        # The top of a frame that looks inwards points to the middle.
        placed += _down(rng, place, angle + 90.0, 35.0)
    return placed


LAYOUTS: dict[str, Callable[[np.random.Generator, float], Placed]] = {
    one.__name__: one for one in (grid, crossed, oblique, corridor, circle)
}


def scene(layout: str, relief: str, camera: Camera, height: float, rng: np.random.Generator) -> Scene:
    """Photographs of a layout and the ground that they show."""
    placed = LAYOUTS[layout](rng, height)
    views = [View(f"p{i:02}", camera, rotation, centre + ORIGIN) for i, (centre, rotation) in enumerate(placed)]
    return Scene(views, *_ground(rng, placed, camera, height, RELIEF[relief]), height)


def _ground(
    rng: np.random.Generator, placed: Placed, camera: Camera, height: float, relief: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of hills with detail, and their upright normals."""
    centres = np.array([centre for centre, _ in placed])
    low, high = centres[:, :2].min(axis=0) - 0.5 * height, centres[:, :2].max(axis=0) + 0.5 * height
    frame = camera.width * camera.height * (height / camera.c) ** 2
    count = int(POINTS_PER_FRAME * np.prod(high - low) / frame)
    xy = rng.uniform(low, high, (count, 2))
    waves, phases = rng.normal(0, 2.5 / height, (4, 2)), rng.uniform(0, 2 * np.pi, 4)
    hills = np.sin(xy @ waves.T + phases).sum(axis=1) / np.sqrt(2.0)
    z = relief * height * (0.9 * hills + 0.4 * rng.standard_normal(count))
    return np.column_stack([xy, z]) + ORIGIN, np.tile([0.0, 0.0, 1.0], (count, 1))
