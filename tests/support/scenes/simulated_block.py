"""Blocks of image measurements with known truth, for tests: no pixels, only geometry and noise."""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera, Cameras, padded
from orthomill.schemas.observations import Control, ControlPoint, TiePoints
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.camera_change import QUARTER_TURNS, turned, upright_name
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.orientation.sensor_frame import Upright


@dataclass(frozen=True)
class SimulatedBlock:
    photos: Photos
    cameras: Cameras
    tie_points: TiePoints
    control: Control
    views: list[View]
    ground: np.ndarray
    wrong: np.ndarray


TRUE_CAMERA = Camera(
    name="cam", width=2400, height=2400, c=1597.4, x0=3.2, y0=-2.1, k1=-0.03, k2=0.01, p1=2e-4, p2=-1e-4, pixel_um=96.0
)
SIGMA_INTERIOR = np.array([0.5, 0.4, 0.4, 4e-4, 8e-4, 0.0, 2e-5, 2e-5])


def calibrated(truth: Camera, rng: np.random.Generator, sigma: np.ndarray = SIGMA_INTERIOR) -> Camera:
    """The camera as a calibration with these standard errors would report it."""
    values = np.array(truth.interior)
    values[: len(sigma)] += sigma * rng.standard_normal(len(sigma))
    covariance = padded(tuple(tuple(float(v) for v in row) for row in np.diag(sigma**2)))
    return truth.with_interior(values).model_copy(update={"covariance": covariance, "source": "chessboards"})


def surface(x, y, height):
    return 100 + height * (0.04 * np.sin(x / height * 3) + 0.05 * np.exp(-((x - 0.3 * height) ** 2 + y**2) / (0.1 * height**2)))


def measured(view, points, rng, sigma):
    pixels = view.project(points)
    inside = view.contains(pixels, 5)
    return pixels + sigma * rng.standard_normal(pixels.shape), inside


def simulate(
    views,
    camera,
    seed,
    *,
    tracks=2000,
    sigma=0.3,
    gnss=0.1,
    control=8,
    check=8,
    wrong=0.0,
    origin=(407000.0, 4357000.0, 0.0),
    stated_sigma=None,
):
    rng = np.random.default_rng(seed)
    height = np.mean([v.centre[2] for v in views]) - 100 - origin[2]
    half = 0.5 * views[0].camera.width / views[0].camera.c * height
    low = np.min([v.centre[:2] for v in views], axis=0) - half - origin[:2]
    high = np.max([v.centre[:2] for v in views], axis=0) + half - origin[:2]

    def ground(count):
        xy = rng.uniform(low, high, (count, 2))
        return np.column_stack([xy, surface(*xy.T, height)]) + origin

    points, rows, truth = ground(4 * tracks), [], []
    seen = [measured(v, points, rng, sigma) for v in views]
    count = np.sum([inside for _, inside in seen], axis=0)
    for t in np.flatnonzero(count >= 2)[:tracks]:
        rows += [(len(truth), p, *seen[p][0][t]) for p in range(len(views)) if seen[p][1][t]]
        truth.append(points[t])
    rows = np.array(rows)
    bad = rng.random(len(rows)) < wrong
    rows[bad, 2:] += rng.uniform(-60, 60, (bad.sum(), 2))
    ties = TiePoints(
        rows[:, 0].astype(np.int32),
        rows[:, 1].astype(np.int32),
        rows[:, 2],
        rows[:, 3],
        np.full(len(rows), stated_sigma or sigma, np.float32),
    )
    targets, known = ground(40 * (control + check) + 1), []
    seen = [measured(v, targets, rng, sigma) for v in views]
    for t in range(len(targets)):
        found = {views[p].name: (*map(float, seen[p][0][t]), sigma) for p in range(len(views)) if seen[p][1][t]}
        if len(found) >= 2 and len(known) < control + check:
            role = "control" if len(known) < control else "check"
            noisy = targets[t] + 0.02 * rng.standard_normal(3)
            known.append(ControlPoint(name=f"P{t}", role=role, xyz=tuple(noisy), sigma=(0.02,) * 3, measurements=found))
    photos = [photo_of(v, None if gnss is None else v.centre + gnss * rng.standard_normal(3), gnss) for v in views]
    cameras = Cameras(cameras={"cam": camera}, of_photo={v.name: "cam" for v in views})
    return SimulatedBlock(Photos(photos=tuple(photos)), cameras, ties, Control(points=tuple(known)), views, np.array(truth), bad)


def photo_of(v, position=None, sigma=None):
    known = {} if position is None else {"position": tuple(position), "position_sigma": (sigma,) * 3}
    size = {"width": v.camera.width, "height": v.camera.height}
    return Photo(name=v.name, path=v.name, bands=3, dtype="uint8", camera="cam", **size, **known)


def view(name, camera, xyz, degrees):
    return View(name, camera, rotation_matrix(*np.radians(degrees)), np.array(xyz, float))


def two_strips(seed=0, sigma_interior=SIGMA_INTERIOR, **options):
    """The volos block: six photos in two strips, the second flown back (turned by 180 degrees)."""
    rng = np.random.default_rng(1000 + seed)
    views = []
    for strip in range(2):
        for i in range(3):
            x = 407000 + 582 * (i if strip == 0 else 2 - i)
            tilt = rng.uniform(-1.5, 1.5, 2)
            kappa = rng.uniform(-2, 2) + 180 * strip
            views.append(
                view(
                    f"s{strip}_{i}",
                    TRUE_CAMERA,
                    (x + rng.normal(0, 10), 4357000 + 624 * strip + rng.normal(0, 10), 1138 + rng.normal(0, 5)),
                    (*tilt, kappa),
                )
            )
    return simulate(views, calibrated(TRUE_CAMERA, rng, sigma_interior), seed, **options)


DRONE = Camera(name="cam", width=2000, height=1125, c=1150.0, k1=-0.01, source="exif")


def one_strip(seed=0, photos=8, camera=DRONE, **options):
    """A drone flies one line with rough positions; its `camera` is known from EXIF only."""
    rng = np.random.default_rng(2000 + seed)
    views = [
        view(
            f"d{i}",
            camera,
            (407000 + 20 * i + rng.normal(0, 0.5), 4357000 + rng.normal(0, 0.5), 180 + rng.normal(0, 0.5)),
            (rng.normal(0, 1), rng.normal(0, 1), 90 + rng.normal(0, 3)),
        )
        for i in range(photos)
    ]
    nominal = DRONE.changed(c=1165.0, k1=0.0)
    return simulate(views, nominal, seed, **({"gnss": 3.0, "control": 0, "check": 0} | options))


def looking(forward, up=(0.0, 0.0, 1.0)):
    """Rotation of a photograph that looks `forward`, with its top up."""
    back = -np.array(forward, float) / np.linalg.norm(forward)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(back, right), back])


def block_of(views, points, rng, sigma=0.3, gnss=1.0, camera=DRONE):
    """A block of `points` (n, 3); those that fewer than two photographs see are left out."""
    seen = [(v.project(points) + sigma * rng.standard_normal((len(points), 2)), v.contains(v.project(points), 5)) for v in views]
    count = np.sum([inside for _, inside in seen], axis=0)
    rows = [(t, p, *seen[p][0][n]) for t, n in enumerate(np.flatnonzero(count >= 2)) for p in range(len(views)) if seen[p][1][n]]
    rows = np.array(rows)
    ties = TiePoints(
        rows[:, 0].astype(np.int32), rows[:, 1].astype(np.int32), rows[:, 2], rows[:, 3], np.full(len(rows), sigma, np.float32)
    )
    photos = Photos(
        photos=tuple(photo_of(v, None if gnss is None else v.centre + gnss * rng.standard_normal(3), gnss) for v in views)
    )
    cameras = Cameras(cameras={"cam": camera}, of_photo={v.name: "cam" for v in views})
    return SimulatedBlock(photos, cameras, ties, Control(), views, points[count >= 2], np.zeros(len(rows), bool))


def turned_upright(block, flags):
    """The block with the photographs of `flags` turned upright by these EXIF orientations, as the stage `photos` describes it."""
    photos = []
    for photo in block.photos.photos:
        flag = flags.get(photo.name, 1)
        size = {"width": photo.height, "height": photo.width} if flag >= 5 else {}
        photos.append(photo.model_copy(update={"exif_orientation": flag, **size}))
    names = {photo.name: upright_name(photo) for photo in photos}
    by_camera = {names[photo.name]: photo.exif_orientation for photo in photos}
    own = {name: turned(block.cameras.cameras["cam"], flag).model_copy(update={"name": name}) for name, flag in by_camera.items()}
    # What takes measurements back to the sensors takes them there for the inverse flags.
    back = [p.model_copy(update={"exif_orientation": QUARTER_TURNS.get(flags.get(p.name, 1), 1)}) for p in block.photos.photos]
    there = Upright(Photos(photos=tuple(back)), block.cameras)
    return replace(
        block,
        photos=Photos(photos=tuple(photos)),
        cameras=Cameras(cameras=own, of_photo=names),
        tie_points=there.sensor_ties(block.tie_points),
        control=there.sensor_control(block.control),
    )
