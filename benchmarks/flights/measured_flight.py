"""A flight as the adjustment gets it: tie points measured with noise and with errors that neighbours share, and what tags say."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.flights.flight_knowledge import RECEIVERS, camera_by_tags, tagged_photos, true_camera
from benchmarks.flights.flown_layouts import LAYOUTS, RELIEF, Scene, scene
from benchmarks.orientation.simulated_scenes import photographed_layouts
from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.observations import TiePoints
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.view import View

KEPT = 0.7
"""Share of the photographs that see a point in which matching finds it."""
MOST_POINTS = 140
"""Tie points for each photograph of the block."""


@dataclass(frozen=True)
class Kind:
    """What makes up a flight, all but chance: its layout, relief, receiver, whether the gimbal told attitudes, and whether the
    camera is `sound`, that is nearly what its tags say."""

    layout: str
    relief: str
    receiver: str
    gimbal: bool
    sound: bool


@dataclass(frozen=True, eq=False)
class Flight:
    """What the product gets, and the truth: the camera, the views, the ground points (N, 3) of the tracks, the flying height, m."""

    kind: Kind
    seed: int
    photos: Photos
    cameras: Cameras
    tie_points: TiePoints
    camera: Camera
    views: list[View]
    ground: np.ndarray
    height: float

    @property
    def ground_pixel(self) -> float:
        """Side of a pixel on the ground, m."""
        return self.height / self.camera.c


def kinds(count: int) -> list[tuple[Kind, int]]:
    """`count` kinds of flights with their seeds, evenly over everything that makes them up; one in five with a sound camera."""
    every = [Kind(*one, False) for one in product(LAYOUTS, RELIEF, RECEIVERS, (True, False))]
    order = np.random.default_rng(35).permutation(len(every))
    chosen = [every[order[i % len(every)]] for i in range(count)]
    return [(Kind(**{**vars(kind), "sound": i % 5 == 4}), i) for i, kind in enumerate(chosen)]


def flight(kind: Kind, seed: int) -> Flight:
    """The flight of a kind with the chances of a seed."""
    rng = np.random.default_rng([35, seed])
    camera, height = true_camera(rng, kind.sound), rng.uniform(40, 110)
    seen = scene(kind.layout, kind.relief, camera, height, rng)
    ties, ground = _measured(seen, rng)
    wrong = rng.uniform(-0.02, 0.02) if kind.sound else rng.uniform(-0.1, 0.1)
    photos = tagged_photos(seen, RECEIVERS[kind.receiver], kind.gimbal, wrong, rng)
    cameras = Cameras(cameras={"cam": camera_by_tags(photos)}, of_photo={view.name: "cam" for view in seen.views})
    return Flight(kind, seed, Photos(photos=photos), cameras, ties, camera, seen.views, ground, height)


def _measured(seen: Scene, rng: np.random.Generator) -> tuple[TiePoints, np.ndarray]:
    sigma, share = rng.uniform(0.1, 0.35), rng.uniform(0.0, 0.4)
    visible = np.array([photographed_layouts.seen_by(seen, view) for view in seen.views])
    found = visible & (rng.random(visible.shape) < KEPT)
    tied = np.sort(rng.permutation(np.flatnonzero(found.sum(axis=0) >= 2))[: MOST_POINTS * len(seen.views) // 4])
    lens = rng.uniform(-1, 1, (2, 3))
    rows = []
    for p, view in enumerate(seen.views):
        number = np.flatnonzero(found[p, tied])
        pixels = view.project(seen.points[tied[number]])
        pixels = pixels + sigma * (rng.standard_normal(pixels.shape) + share * _shared(pixels, view.camera, lens, rng))
        rows.append(np.column_stack([number, np.full(len(number), p), pixels]))
    table = np.vstack(rows)
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    numbers = (table[:, i].astype(np.int32) for i in (0, 1))
    return TiePoints(*numbers, table[:, 2], table[:, 3], np.full(len(table), sigma, np.float32)), seen.points[tied]


def _shared(pixels: np.ndarray, camera: Camera, lens: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 2) errors of unit size that neighbours share: a shutter that runs while the camera trembles, other in each photograph,
    and a `lens` (2, 3) that is no polynomial, the same in all."""
    row = 2 * np.pi * pixels[:, 1:] / camera.height
    trembling = np.sin(rng.uniform(0.5, 2.0, 2) * row + rng.uniform(0, 2 * np.pi, 2)) * rng.normal(0, 1.0, 2)
    col = 2 * np.pi * pixels[:, :1] / camera.width
    wavy = np.sin(2 * col + 6 * lens[:, 0]) * lens[:, 1] + np.cos(1.5 * row + 6 * lens[:, 2]) * lens[:, 1]
    return trembling + 0.5 * wavy
