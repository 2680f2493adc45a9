"""Boards anywhere in space, identified by their poses; and boards that are stated to lie on one plane and do not."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.geometry.view import View

CAMERA = Camera(name="t", width=4000, height=3000, c=3200, x0=10, y0=-8, k1=-0.1, k2=0.02)
TARGET = CalibrationTarget((4000, 3000), (6, 5), 0.03, 0, "space")


@dataclass(frozen=True)
class Scene:
    """`depth` m: how far boards stand before and behind each other; `missing`: share of boards that a photo lacks."""

    seed: int
    boards: int = 4
    photos: int = 8
    depth: float = 1.0
    missing: float = 0.2


def corners(scene: Scene) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Per photo the corners (B, 30, 2) of whole boards in random order with 0.3 px of noise, and their true numbers."""
    generator = np.random.default_rng(scene.seed)
    local = np.column_stack([TARGET.local, np.zeros(30)]) - [0.075, 0.06, 0.0]
    side = int(np.ceil(np.sqrt(scene.boards)))
    points = []
    for board in range(scene.boards):
        turn = rotation_of_vector(np.append(generator.uniform(-0.8, 0.8, 2), generator.uniform(-3, 3)))
        place = np.array([0.32 * (board % side), 0.32 * (board // side), generator.uniform(-0.5, 0.5) * scene.depth])
        points.append((local @ turn.T + place, turn[:, 2]))
    found, order = [], []
    for photo in range(scene.photos):
        around, tilt = 2 * np.pi * photo / scene.photos, generator.uniform(0.15, 0.6)
        R = rotation_matrix(tilt * np.sin(around), tilt * np.cos(around), generator.uniform(-3, 3))
        middle = np.mean([own.mean(axis=0) for own, _ in points], axis=0)
        view = View("v", CAMERA, R, middle + generator.uniform(1.3, 1.9) * R[2])
        shown, pixels = [], []
        for board, (own, normal) in enumerate(points):
            xy, towards = view.project(own), view.centre - own.mean(axis=0)
            seen = view.contains(xy, 2.0).all() and towards @ normal > 0.35 * np.linalg.norm(towards)
            if seen and generator.uniform() > scene.missing:
                shown.append(board)
                pixels.append(xy + generator.normal(0, 0.3, xy.shape))
        mixed = generator.permutation(len(shown))
        found.append(TARGET.centred(np.array(pixels).reshape(-1, 30, 2)[mixed]))
        order.append(np.array(shown, dtype=int)[mixed])
    return found, order


@pytest.mark.parametrize(
    "scene",
    [Scene(1), Scene(2, boards=2), Scene(3, boards=7), Scene(4, depth=3.0), Scene(5, depth=0.0), Scene(6, photos=3, missing=0.0)],
    ids=str,
)
def test_boards_in_space_are_identified_and_calibrate_the_camera(scene):
    found, order = corners(scene)
    known = arrangement_of(found, TARGET)
    pairs = {
        (int(n), int(t))
        for own, true in zip(known.naming.photos, order, strict=True)
        if own.certain
        for n, t in zip(own.names, true, strict=True)
        if n >= 0
    }
    assert len(pairs) == len({n for n, _ in pairs}) == len({t for _, t in pairs}) == scene.boards
    assert known.result.sigma0 == pytest.approx(0.3, rel=0.15)
    sigma = np.sqrt(np.diag(known.result.interior_covariance))[:5]
    assert (np.abs(known.result.state.interior[:5] - CAMERA.interior[:5]) < 4.5 * sigma).all()


def test_one_photo_of_boards_that_face_different_ways_is_enough_and_one_of_two_is_not():
    found, _ = corners(Scene(2, boards=5, photos=1, missing=0.0))
    known = arrangement_of(found, TARGET)
    assert known.result.redundancy > 0 and known.result.sigma0 == pytest.approx(0.3, rel=0.2)
    with pytest.raises(GeometryError, match="Only 1 photograph shows"):
        arrangement_of([found[0][:2]], TARGET)


@pytest.mark.parametrize("seed", [0, 2])
def test_boards_that_do_not_lie_on_the_stated_plane_are_refused_with_what_to_do(seed):
    found, _ = corners(Scene(seed))
    with pytest.raises(GeometryError, match=r"not lie still on one plane: each by itself fits to 0\.\d+ px.*arrangement space"):
        arrangement_of(found, replace(TARGET, arrangement="plane"))
