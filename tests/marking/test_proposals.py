"""Marks carried by matching and found as targets, on pictures with known truth."""

import cv2
import numpy as np
import pytest

from benchmarks.marking.drawn_targets import drawn, nearest
from benchmarks.marking.simulated_marks import simulated_block
from orthomill.schemas.marks import ExpectedSight, FoundTarget, MarkedPoint
from orthomill.tasks.marking.expected_targets import target_proposals, unexpected_targets
from orthomill.tasks.marking.patch_matching import CarriedPatch, SearchedPatch, carried, carried_from
from orthomill.tasks.targets.photo_targets import photo_targets, stretched, targets_in
from orthomill.tasks.targets.square_codes import crossing
from orthomill.tasks.targets.symmetric_centre import symmetric_centre


def ground(seed=0, side=400):
    noise = np.random.default_rng(seed).normal(0, 1, (side, side)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return 120 + 30 * smooth / smooth.std()


def turned(picture, angle, scale, gain):
    """A picture turned and scaled about its middle, brighter; and its affine (2, 3)."""
    middle = (np.array(picture.shape[::-1]) - 1) / 2
    A = cv2.getRotationMatrix2D((float(middle[0]), float(middle[1])), angle, scale)
    return cv2.warpAffine(picture, A, picture.shape[::-1], flags=cv2.INTER_CUBIC) * gain + 10, A


@pytest.mark.parametrize(("angle", "scale"), [(0.0, 1.0), (140.0, 0.8), (-75.0, 1.3)])
def test_a_mark_is_carried_over_turn_scale_and_light(angle, scale):
    picture = ground()
    other, A = turned(picture, angle, scale, 0.8)
    place = np.array([207.3, 190.6])
    there = A @ [*place, 1.0]
    marked = CarriedPatch(picture, place, 0.05, A[:, :2])
    found = carried([marked], SearchedPatch(other, there + np.array([3.0, -4.0]), 9.0 * np.eye(2)))
    assert found.refused == ""
    assert np.linalg.norm(found.place - there) < 0.1
    assert found.sigma < 0.3


def test_a_pattern_that_repeats_is_refused():
    x = np.arange(400)
    rows = 120 + 50 * np.sin(x / 2.5)[None, :] * np.sin(x / 2.5)[:, None]
    picture = (rows + np.random.default_rng(1).normal(0, 2, rows.shape)).astype(np.float32)
    place = np.array([200.0, 200.0])
    found = carried_from(CarriedPatch(picture, place, 0.1, np.eye(2)), SearchedPatch(picture, place, 100.0 * np.eye(2)))
    assert "another place" in found.refused
    # A prediction that leaves one of them only decides it.
    near = carried_from(CarriedPatch(picture, place, 0.1, np.eye(2)), SearchedPatch(picture, place, 0.5 * np.eye(2)))
    assert near.refused == "" and np.linalg.norm(near.place - place) < 0.1


@pytest.mark.parametrize("searched", ["other", "flat", "outside"])
def test_where_the_point_is_not_nothing_is_proposed(searched):
    picture = {
        "other": ground(7),
        "flat": np.full((400, 400), 90.0, np.float32),
        "outside": np.full((400, 400), np.nan, np.float32),
    }
    marked = CarriedPatch(ground(), np.array([200.0, 200.0]), 0.1, np.eye(2))
    assert carried([marked], SearchedPatch(picture[searched], np.array([200.0, 200.0]), 25.0 * np.eye(2))).refused


def test_no_mark_carries_nothing():
    assert carried([], SearchedPatch(ground(), np.array([200.0, 200.0]), np.eye(2))).refused


@pytest.mark.parametrize("kind", ["chequered", "cross", "circle"])
def test_centres_of_drawn_targets_are_good_to_a_tenth_of_a_pixel(kind):
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(8):
        picture, centre = drawn(kind, rng)
        one = nearest(photo_targets(picture, 3000.0), kind, centre)
        if one is not None:
            errors.append((np.array(one.place) - centre, one.sigma))
    assert len(errors) == 8
    away = np.array([error for error, _ in errors])
    assert np.sqrt((away**2).mean()) < 0.05
    assert np.sqrt(np.mean([(error**2).mean() / sigma**2 for error, sigma in errors])) < 2.0


def test_a_coded_target_names_itself():
    rng = np.random.default_rng(3)
    for _ in range(4):
        picture, centre = drawn("tag36h11", rng)
        (one,) = (one for one in photo_targets(picture) if one.kind == "coded")
        assert one.name == "tag36h11-7" and np.linalg.norm(centre - one.place) < 4 * one.sigma


def test_ground_without_targets_has_none_that_is_certain():
    assert not [one for one in photo_targets(ground(11, 500)) if one.kind != "circle" and one.score > 0.9]


def test_what_looks_like_a_target_in_one_photograph_is_none_but_what_all_show_is():
    block = simulated_block(2, 4, seed=2, ties=100)
    rng = np.random.default_rng(4)
    place = np.array([25.0, 20.0, 0.5])
    found = {view.name: [target(*rng.uniform(100, 2900, 2)) for _ in range(15)] for view in block.views}
    shown = set()
    for view in block.views:
        pixel = view.project(place[None])[0]
        if view.contains(pixel[None], 20)[0]:
            shown.add(view.name)
            found[view.name].append(target(*(pixel + rng.normal(0, 0.1, 2))))
    points = unexpected_targets(block.belief, lambda photo: tuple(found[photo]))
    assert len(shown) >= 4
    assert [set(point) for point in points] == [shown]


def test_a_corner_is_no_centre_of_symmetry():
    y, x = np.mgrid[:60, :60]
    corner = np.where((x > 30) & (y > 30), 200.0, 40.0).astype(np.float32)
    found = symmetric_centre(cv2.GaussianBlur(corner, (0, 0), 1.0), np.array([30.5, 30.5]), 8.0)
    assert found is None or found.unexplained > 0.06


def test_diagonals_that_are_parallel_do_not_meet():
    assert np.isnan(crossing(np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]) @ np.array([[1.0, 0.0], [0.0, 0.0]]))).all()


def test_pictures_of_any_depth_have_the_same_targets():
    picture, _ = drawn("chequered", np.random.default_rng(6))
    eight = targets_in(picture.astype(np.uint8)[..., None])
    sixteen = targets_in((picture * 200).astype(np.uint16)[..., None])
    assert eight and np.linalg.norm(np.subtract(eight[0].place, sixteen[0].place)) < 0.05
    assert stretched((picture * 200).astype(np.uint16)).max() <= 255.0


def target(col, row, name="", score=0.9):
    return FoundTarget("coded" if name else "chequered", (col, row), 0.05, 6.0, score, name)


@pytest.mark.parametrize(
    ("there", "expected"),
    [
        ((target(101.0, 99.0),), (101.0, "")),
        ((target(101.0, 99.0), target(103.0, 100.0)), (101.0, "2 targets lie where it is expected")),
        ((target(101.0, 99.0), target(103.0, 100.0, "P")), (103.0, "")),
        ((target(101.0, 99.0, "Q"),), None),
        ((target(140.0, 99.0),), None),
        ((target(101.0, 99.0, score=0.3),), None),
    ],
)
def test_the_one_target_where_a_point_is_expected(there, expected):
    sight = ExpectedSight("a", (100.0, 100.0), 4.0 * np.eye(2), "block", (1.0, 0.5), 50.0)
    found = target_proposals(MarkedPoint(name="P"), (sight,), lambda asked: there)
    assert [(one.place[0], one.refused) for one in found] == ([] if expected is None else [expected])
