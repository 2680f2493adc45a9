"""Boards that look the same after half or quarter turns: one, several in a plane, several in space."""

import numpy as np
import pytest

from orthomill.schemas.camera import Camera
from orthomill.tasks.calibration.detection.board_turns import coloured, corner_orders, in_order, symmetric
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.geometry.view import View

CAMERA = Camera(name="t", width=4000, height=3000, c=3200, x0=10, y0=-8, k1=-0.1, k2=0.02)
PLACES = np.array([[0.0, 0.0, 0.2], [0.35, 0.05, 1.7], [-0.02, 0.33, -0.4], [0.4, 0.36, 2.6]])


@pytest.mark.parametrize(
    ("corners", "turns", "colours"),
    [((9, 6), 1, True), ((7, 5), 2, False), ((8, 6), 2, False), ((6, 6), 4, False), ((7, 7), 2, True), ((5, 6), 1, True)],
)
def test_the_turns_that_change_nothing_are_known(corners, turns, colours):
    assert len(corner_orders(corners)) == turns and symmetric(corners) is (turns > 1) and coloured(corners) is colours
    white = np.add.outer(np.arange(corners[1] + 1), np.arange(corners[0] + 1)) % 2
    assert sum(np.array_equal(np.rot90(white, turn), white) for turn in range(4)) == turns, "black squares stay black"
    assert any(np.array_equal(np.rot90(white, turn), 1 - white) for turn in range(4)) is colours
    local = CalibrationTarget((1, 1), corners, 0.1).local
    for order in corner_orders(corners):
        assert sorted(order) == list(range(len(local)))
        apart = np.linalg.norm(local[:, None] - local[None], axis=2)
        assert np.linalg.norm(local[order][:, None] - local[order][None], axis=2) == pytest.approx(apart), "a rigid motion"


def photographed(target: CalibrationTarget, boards: int, seed: int) -> list[np.ndarray]:
    """Per photo the corners (B, N, 2) of all boards in random order and counted from a random end, with 0.2 px of noise."""
    generator = np.random.default_rng(seed)
    flat = np.column_stack([target.local - target.local.mean(axis=0), np.zeros(len(target.local))])
    tilt = 0.3 if target.arrangement == "space" else 0.0
    points = []
    for x, y, angle in PLACES[:boards]:
        lean = rotation_of_vector(tilt * generator.uniform(-1, 1, 3)) @ rotation_of_vector(np.array([0.0, 0.0, angle]))
        points.append(flat @ lean.T + [x, y, tilt * generator.uniform(-0.3, 0.3)])
    found = []
    for photo in range(8):
        side = 2.4 * photo
        R = rotation_matrix(0.45 * np.sin(side), 0.45 * np.cos(side), generator.uniform(-3, 3))
        view = View("v", CAMERA, R, np.mean(points, axis=(0, 1)) + 1.3 * R[2])
        xy = np.array([view.project(own) for own in points]) + generator.normal(0, 0.2, (boards, len(flat), 2))
        turns = generator.integers(0, len(target.orders), boards)
        found.append(in_order(target.centred(xy), turns, target.orders)[generator.permutation(boards)])
    return found


@pytest.mark.parametrize("corners", [(6, 4), (4, 4)])
@pytest.mark.parametrize(("boards", "arrangement"), [(1, "plane"), (4, "plane"), (4, "space")])
def test_boards_without_a_first_corner_calibrate_like_others(corners, boards, arrangement):
    target = CalibrationTarget((4000, 3000), corners, 0.03, 0, arrangement)
    known = arrangement_of(photographed(target, boards, 3), target)
    assert all((photo.names >= 0).all() and photo.certain for photo in known.naming.photos)
    assert known.result.network.boards == boards and known.result.used.mean() > 0.99
    assert known.result.sigma0 == pytest.approx(0.2, rel=0.12)
    sigma = np.sqrt(np.diag(known.result.interior_covariance))[:5]
    assert (np.abs(known.result.state.interior[:5] - CAMERA.interior[:5]) < 4.0 * sigma).all()


def test_a_photo_whose_boards_can_be_exchanged_keeps_one_of_them():
    target = CalibrationTarget((4000, 3000), (6, 4), 0.03)
    two = [own[:2] for own in photographed(target, 2, 5)]
    assert all(photo.certain for photo in arrangement_of(two, target).naming.photos), "boards that lie askew have one answer"
    parallel = np.array([[0.0, 0.0, 0.2], [0.35, 0.05, 0.2]])
    flat = np.column_stack([target.local - target.local.mean(axis=0), np.zeros(24)])
    points = [flat @ rotation_of_vector(np.array([0.0, 0.0, a])).T + [x, y, 0.0] for x, y, a in parallel]
    found = []
    for side in np.arange(6) * 2.4:
        R = rotation_matrix(0.45 * np.sin(side), 0.45 * np.cos(side), side)
        view = View("v", CAMERA, R, np.mean(points, axis=(0, 1)) + 1.3 * R[2])
        noise = np.random.default_rng(int(10 * side)).normal(0, 0.2, (2, 24, 2))
        found.append(target.centred(np.array([view.project(own) for own in points]) + noise))
    known = arrangement_of(found, target)
    assert [(photo.names >= 0).sum() for photo in known.naming.photos] == [1] * 6 and not known.naming.photos[0].certain
    assert abs(known.result.state.interior[0] - 3200) < 4.0 * np.sqrt(known.result.interior_covariance[0, 0])
