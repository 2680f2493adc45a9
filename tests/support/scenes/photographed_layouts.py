"""Sixty layouts of photographs as people take them: twelve shapes, five kinds of knowledge of where they are. No pixels.

A point of the scene is measured where a photograph sees it from no more than 60 degrees off its normal: matching connects views of
a surface that differ by less, and walls hide what lies behind them.
"""

from dataclasses import dataclass

import numpy as np
from simulated_block import DRONE, SimulatedBlock, calibrated, looking, photo_of

from orthomill.schemas.camera import Cameras
from orthomill.schemas.observations import Control, ControlPoint, Distance, TiePoints
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

ORIGIN = np.array([407000.0, 4357000.0, 100.0])
FACING = 0.5
"""Cosine of the largest angle between the normal of a point and the ray to a photograph that measures it."""
TRACKS, SIGMA, LEAST_SEEN = 300, 0.3, 3
"""Tie points of a layout; standard error of their measurements, px; photographs in which a target is measured at least."""
SIGNAL = 0.02
"""m: standard error of control points, at a distance of 80 m; shorter distances have proportionally better ones"""


@dataclass(frozen=True)
class Scene:
    """Photographs, and the points of what they show with the normals of its surface; `distance` (m) between both."""

    views: list[View]
    points: np.ndarray
    normals: np.ndarray
    distance: float


@dataclass(frozen=True)
class Knowledge:
    """What is known: standard error of positions in m (None: no positions; `share`: of the distance instead), number of `control`
    and `check` points, whether control lies at one end, number of measured `distances`, whether the camera is calibrated."""

    gnss: float | None = None
    share: bool = False
    control: int = 0
    check: int = 0
    one_sided: bool = False
    distances: int = 0
    calibrated: bool = False


KNOWLEDGE = {
    "rough positions": Knowledge(gnss=3.0),
    "good positions": Knowledge(gnss=0.03, calibrated=True),
    "control": Knowledge(control=8, check=4),
    "control at one end": Knowledge(gnss=3.0, control=5, one_sided=True),
    "distances": Knowledge(distances=6, calibrated=True),
}


def _nadir(rng, places, heading=0.0, tilt=1.5):
    """Photographs at `places` (n, 3) that look down, the top of the frame towards `heading` (degrees, or one for each)."""
    turns = np.broadcast_to(heading, len(places))
    return [
        (place + rng.normal(0, 0.6, 3), rotation_matrix(*np.radians((*rng.normal(0, tilt, 2), turn + rng.normal(0, 3)))))
        for place, turn in zip(places, turns, strict=True)
    ]


def _towards(rng, places, aims, shake=0.02):
    """Photographs at `places` (n, 3) that look at `aims` (n, 3)."""
    ahead = np.asarray(aims, float) - places
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return [
        (place + rng.normal(0, 0.1, 3), looking(axis + shake * rng.standard_normal(3)))
        for place, axis in zip(places, ahead, strict=True)
    ]


def _ground(rng, low, high, relief, count):
    """Points of rolling ground; normals that lean to a random side, as what is seen from one side only."""
    xy = rng.uniform(low, high, (count, 2))
    z = relief * (np.sin(xy[:, 0] / 17.0) + np.cos(xy[:, 1] / 23.0) + 0.3 * rng.standard_normal(count))
    side, lean = rng.uniform(0, 2 * np.pi, count), np.radians(20)
    return np.column_stack([xy, z]), np.column_stack(
        [np.sin(lean) * np.cos(side), np.sin(lean) * np.sin(side), np.full(count, np.cos(lean))]
    )


def _around(rng, photos, radius, height):
    angle = 2 * np.pi * np.arange(photos) / photos + rng.normal(0, 0.04, photos)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(photos, height) + rng.normal(0, 0.5, photos)])


def _tower(rng, radius, height, count):
    """Points of an upright cylinder with relief, and their normals."""
    angle, z = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, height, count)
    r = radius * (1 + 0.08 * np.sin(5 * angle) + 0.05 * rng.standard_normal(count))
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    return out * r[:, None] + z[:, None] * [0, 0, 1], out


def one_strip(rng, count):
    along = 20.0 * np.arange(10)
    return _nadir(rng, np.column_stack([along, 0 * along, 80 + 0 * along]), 90), _ground(rng, (-60, -60), (240, 60), 4, count), 80


def two_strips(rng, count):
    places = [(22.0 * i, 45.0 * s, 80.0) for s in range(2) for i in range(6)]
    return _nadir(rng, np.array(places), [90] * 6 + [-90] * 6), _ground(rng, (-60, -60), (170, 100), 4, count), 80


def cross(rng, count):
    arm = 20.0 * (np.arange(7) - 3)
    places = np.vstack([np.column_stack([arm, 0 * arm]), np.column_stack([0 * arm + 2, arm + 3])])
    return _nadir(rng, np.column_stack([places, np.full(14, 80.0)]), [90] * 7 + [0] * 7), _ground(rng, -110, 110, 4, count), 80


def crossed_block(rng, count):
    places = [(28.0 * i, 40.0 * s, 80.0) for s in range(3) for i in range(4)] + [
        (28.0 * (3 * s), 40.0 * i, 95.0) for s in range(2) for i in range(3)
    ]
    return _nadir(rng, np.array(places), [90] * 12 + [0] * 6), _ground(rng, -60, 150, 4, count), 80


def circle(rng, count):
    places = _around(rng, 16, 30, 22)
    (p, n), (q, m) = _tower(rng, 6, 14, 2 * count), _ground(rng, -20, 20, 0.5, count)
    return _towards(rng, places, np.tile([0, 0, 6.0], (16, 1))), (np.vstack([p, q]), np.vstack([n, m])), 30


def two_circles(rng, count):
    places = np.vstack([_around(rng, 12, 26, 5), _around(rng, 8, 24, 24)])
    (p, n), (q, m) = _tower(rng, 6, 14, 2 * count), _ground(rng, -20, 20, 0.5, count)
    return _towards(rng, places, np.tile([0, 0, 6.0], (20, 1))), (np.vstack([p, q]), np.vstack([n, m])), 28


def facade(rng, count):
    along = 3.0 * np.arange(12)
    wall = np.column_stack([rng.uniform(-12, 45, count), 0.4 * rng.standard_normal(count), rng.uniform(-2, 14, count)])
    places = np.column_stack([along, -15 + 0 * along, 1.7 + 0 * along])
    return _towards(rng, places, places + np.array([0, 15, 3.0])), (wall, np.tile([0, -1.0, 0], (count, 1))), 15


def corner(rng, count):
    """Round the corner of a building."""
    along, side = rng.uniform(0, 22, count), rng.random(count) < 0.5
    rough, z = 0.3 * rng.standard_normal(count), rng.uniform(-1, 12, count)
    wall = np.where(side[:, None], np.column_stack([-along, rough, z]), np.column_stack([rough, along, z]))
    normal = np.where(side[:, None], [0, -1.0, 0], [1.0, 0, 0])
    turn, walked = np.radians(np.linspace(-85, -5, 6)), np.array([12.0, 8.0, 4.0, 1.0])
    there = np.column_stack([-walked, np.full(4, -14.0)]), np.column_stack([2 - walked, np.zeros(4)])
    round_it = 14 * np.column_stack([np.cos(turn), np.sin(turn)]), np.zeros((6, 2))
    back = np.column_stack([np.full(4, 14.0), walked[::-1]]), np.column_stack([np.zeros(4), walked[::-1] - 2])
    places, aims = (np.vstack(parts) for parts in zip(there, round_it, back, strict=True))
    up = np.full((14, 1), 1.7), np.full((14, 1), 4.5)
    return _towards(rng, np.hstack([places, up[0]]), np.hstack([aims, up[1]])), (wall, normal), 15


def kite(rng, count):
    """Oblique and irregular, by a swinging picavet."""
    places = np.column_stack([rng.uniform(-40, 40, 16), np.linspace(-60, 60, 16), rng.uniform(55, 105, 16)])
    aims = np.column_stack([rng.uniform(-25, 25, 16), np.linspace(-45, 45, 16) + rng.uniform(0, 40, 16), np.zeros(16)])
    return _towards(rng, places, aims), _ground(rng, -150, 150, 4, 2 * count), 90


def corridor(rng, count):
    """A road with a bend, photographed once along it."""
    turn = np.radians(np.linspace(0, 70, 16))
    places = np.column_stack([240 * np.sin(turn), 240 * (1 - np.cos(turn)), np.full(16, 70.0)])
    points, normals = _ground(rng, (-60, -60), (300, 240), 3, 3 * count)
    near = np.linalg.norm(points[:, None, :2] - places[None, :, :2], axis=2).min(axis=1) < 45
    return _nadir(rng, places, np.degrees(turn) - 90), (points[near], normals[near]), 70


def cave(rng, count):
    """A passage that bends, photographed while walking through it."""

    def axis(s):
        return np.column_stack([s, 0.03 * s**2, 0.4 * np.sin(s / 4)])

    s, around = rng.uniform(-2, 30, 3 * count), rng.uniform(0, 2 * np.pi, 3 * count)
    out = np.column_stack([np.zeros(3 * count), np.cos(around), np.sin(around)])
    # The floor and the sides of a passage are as rough as that.
    wall = axis(s) + out * (2.5 + 0.3 * rng.standard_normal(3 * count))[:, None]
    walked = np.arange(14) * 1.3
    # Walls that are looked along are seen from behind their roughness: normals lean towards where people come from.
    normals = -0.6 * out - [0.8, 0, 0]
    return _towards(rng, axis(walked), axis(walked + 6.0), 0.05), (wall, normals), 7


def dome(rng, count):
    flat = np.array([(25.0 * i, 25.0 * j, 80.0) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    ring = _around(rng, 9, 70, 60)
    views = _nadir(rng, flat, 90) + _towards(rng, ring, np.zeros((9, 3)))
    return views, _ground(rng, -80, 80, 4, 2 * count), 85


SHAPES = (one_strip, two_strips, cross, crossed_block, circle, two_circles, facade, corner, kite, corridor, cave, dome)
LAYOUTS = [(shape.__name__, knowledge) for shape in SHAPES for knowledge in KNOWLEDGE]
"""Shape and knowledge of each of the sixty layouts."""


def scene_of(shape: str, seed: int) -> Scene:
    rng = np.random.default_rng([seed, [one.__name__ for one in SHAPES].index(shape)])
    placed, (points, normals), distance = {one.__name__: one for one in SHAPES}[shape](rng, 4 * TRACKS)
    views = [View(f"p{i:02}", DRONE, rotation, centre + ORIGIN) for i, (centre, rotation) in enumerate(placed)]
    return Scene(views, points + ORIGIN, normals / np.linalg.norm(normals, axis=1, keepdims=True), float(distance))


def seen_by(scene: Scene, view: View) -> np.ndarray:
    """(N,) bool: the points that a photograph measures."""
    away = view.centre - scene.points
    length = np.linalg.norm(away, axis=1)
    facing = (away * scene.normals).sum(axis=1) > FACING * length
    inside = view.contains(view.project(scene.points), 5) & _in_field(view, scene.points)
    return inside & facing & (length < 3 * scene.distance)


def _in_field(view: View, points: np.ndarray) -> np.ndarray:
    """(N,) bool: points within the angle of the frame's corners; beyond it the polynomial of the distortion folds back into the
    frame, which a lens does not."""
    sight = (points - view.centre) @ view.rotation.T
    return np.asarray((sight[:, :2] ** 2).sum(axis=1) <= view.field * sight[:, 2] ** 2)


def layout(shape: str, knowledge: str, seed: int = 0) -> SimulatedBlock:
    """A layout with noise of the stated sizes, and without a blunder."""
    scene, known = scene_of(shape, seed), KNOWLEDGE[knowledge]
    rng = np.random.default_rng([7, seed, LAYOUTS.index((shape, knowledge))])
    seen = np.array([seen_by(scene, view) for view in scene.views])
    shots = np.array([view.project(scene.points) for view in scene.views]) + SIGMA * rng.standard_normal((*seen.shape, 2))
    count = seen.sum(axis=0)
    tied = np.sort(rng.permutation(np.flatnonzero(count >= 2))[:TRACKS])
    rows = np.array([(t, p, *shots[p, n]) for t, n in enumerate(tied) for p in np.flatnonzero(seen[:, n])])
    ties = TiePoints(*(rows[:, i].astype(np.int32) for i in (0, 1)), rows[:, 2], rows[:, 3], np.full(len(rows), SIGMA, np.float32))
    free = np.setdiff1d(np.flatnonzero(count >= LEAST_SEEN), tied)
    camera = calibrated(DRONE, rng) if known.calibrated else DRONE.changed(c=1165.0, k1=0.0)
    photos = tuple(
        photo_of(v, None if known.gnss is None else v.centre + known.gnss * rng.standard_normal(3), known.gnss) for v in scene.views
    )
    return SimulatedBlock(
        Photos(photos=photos),
        Cameras(cameras={"cam": camera}, of_photo={v.name: "cam" for v in scene.views}),
        ties,
        _control(scene, known, free, (seen, shots), rng),
        scene.views,
        scene.points[tied],
        np.zeros(len(rows), bool),
    )


def _control(scene, known, free, measured, rng) -> Control:
    """Control and check points far from each other, or control at one end of the block; tie points with distances."""
    seen, shots = measured
    wanted = known.control + known.check or 2 * known.distances
    if not wanted:
        return Control()
    if known.one_sided:
        end = scene.points[free] @ np.linalg.svd(scene.points[free] - scene.points[free].mean(axis=0), full_matrices=False)[2][0]
        free = free[np.argsort(end)[: len(free) // 4]]
    chosen = _far_apart(scene.points[free], wanted)
    sigma = SIGNAL * scene.distance / 80
    roles = ["tie"] * wanted if known.distances else ["control"] * known.control + ["check"] * known.check
    points = tuple(
        ControlPoint(
            name=f"G{i}",
            role=roles[i],
            xyz=tuple(scene.points[free[n]] + sigma * rng.standard_normal(3)) if not known.distances else (0.0, 0.0, 0.0),
            sigma=(sigma,) * 3,
            measurements={scene.views[p].name: (*map(float, shots[p, free[n]]), SIGMA) for p in np.flatnonzero(seen[:, free[n]])},
        )
        for i, n in enumerate(chosen)
    )
    true = scene.points[free[chosen]]
    distances = tuple(
        Distance(
            first=f"G{2 * i}",
            second=f"G{2 * i + 1}",
            length=float(np.linalg.norm(true[2 * i] - true[2 * i + 1]) + sigma * rng.standard_normal()),
            sigma=sigma,
        )
        for i in range(known.distances)
    )
    return Control(points=points, distances=distances)


def _far_apart(points, count):
    """Numbers of `count` points, each the farthest from all before it."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    while len(chosen) < count:
        near = np.linalg.norm(points[:, None] - points[chosen][None], axis=2).min(axis=1)
        chosen.append(int(near.argmax()))
    return np.array(chosen)
