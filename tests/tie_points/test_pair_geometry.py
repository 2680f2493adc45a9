"""The epipolar check of a pair against known geometry, and the rule by which pairs are accepted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.tie_points.match_records import Features, PairSummary
from orthomill.tasks.tie_points.pair_matching import (
    PairRules,
    PhotoPair,
    accepted_matches,
    epipolar_agreement,
    epipolar_matrix,
    epipolar_scatter,
    sampson_distance,
    without_parallax,
)
from orthomill.tasks.tie_points.pair_selection import Neighbourhood, candidate_pairs, viewed_ground

CAMERA = Camera(name="c", width=1000, height=800, c=900.0, source="given")
CAMERAS = Cameras(cameras={"c": CAMERA}, of_photo={"a": "c", "b": "c"})
PAIR = PhotoPair.of(CAMERAS, ("a", "b"))
RULES = PairRules(0.8, 1.5)
LEFT = View("a", CAMERA, rotation_matrix(0.02, -0.01, 0.1), np.array([0.0, 0.0, 100.0]))
RIGHT = View("b", CAMERA, rotation_matrix(-0.01, 0.03, -0.2), np.array([30.0, 4.0, 103.0]))


def homologous(count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Exact pixels of random ground points in both photographs."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack([rng.uniform(-15, 45, count), rng.uniform(-30, 30, count), rng.uniform(0, 25, count)])
    return LEFT.project(ground), RIGHT.project(ground)


def features(pixels: np.ndarray) -> Features:
    one = np.ones(len(pixels), np.float32)
    return Features(pixels[:, 0].copy(), pixels[:, 1].copy(), one, 0 * one, one)


def accepted(left: np.ndarray, right: np.ndarray):
    pairs = np.column_stack([np.arange(len(left))] * 2)
    return accepted_matches((features(left), features(right)), pairs, PAIR, RULES)


def true_matrix() -> np.ndarray:
    """F from the orientations, for image coordinates from the principal point, y up."""
    rotation = RIGHT.rotation @ LEFT.rotation.T
    base = RIGHT.rotation @ (LEFT.centre - RIGHT.centre)
    cross = np.array([[0, -base[2], base[1]], [base[2], 0, -base[0]], [-base[1], base[0], 0]])
    into = np.diag([1 / CAMERA.c, 1 / CAMERA.c, -1.0])
    return into @ cross @ rotation @ into


def image(pixels: np.ndarray) -> np.ndarray:
    return np.column_stack([pixels[:, 0] - (CAMERA.width - 1) / 2, (CAMERA.height - 1) / 2 - pixels[:, 1]])


def test_the_sampson_distance_of_exact_matches_is_zero():
    left, right = (image(part) for part in homologous(50))
    assert sampson_distance(true_matrix(), left, right).max() < 1e-9


@settings(max_examples=40, deadline=None)
@given(shift=st.floats(0.01, 1.5), scale=st.floats(1e-3, 1e3))
def test_the_sampson_distance_shares_a_shift_between_both_points(shift, scale):
    """Moved by d across its line, a point has the distance d / root 2 in pairs of equal scale, whatever the scale of the matrix."""
    left, right = (image(part) for part in homologous(40, seed=2))
    lines = np.column_stack([left, np.ones(len(left))]) @ true_matrix().T
    across = lines[:, :2] / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    found = sampson_distance(scale * true_matrix(), left, right + shift * across)
    assert np.allclose(found, shift / np.sqrt(2.0), rtol=0.15)
    along = np.column_stack([-across[:, 1], across[:, 0]])
    assert sampson_distance(true_matrix(), left, right + 50 * along).max() < 1e-6, "a shift along the line is not seen"


@pytest.mark.parametrize("source", ["given", "exif"])
def test_the_geometry_is_found_among_gross_errors(source):
    camera = CAMERA.model_copy(update={"source": source})
    left, right = homologous(300)
    wrong = np.arange(300) % 4 == 0
    right[wrong] += np.random.default_rng(3).uniform(40, 200, (wrong.sum(), 2))
    agree = epipolar_agreement((left, right), (camera, camera), 1.5)
    assert agree[~wrong].mean() > 0.97 and agree[wrong].mean() < 0.1


def test_a_wrong_nominal_constant_does_no_harm_but_a_given_one_does():
    left, right = homologous(300)
    share = {}
    for source in ("exif", "given"):
        camera = CAMERA.model_copy(update={"source": source, "c": 500.0})
        share[source] = epipolar_agreement((left, right), (camera, camera), 0.3).mean()
    assert share["exif"] > 0.97 > share["given"]


def test_too_few_matches_have_no_geometry():
    left, right = homologous(15)
    assert epipolar_matrix((image(left), image(right)), PAIR.cameras, 1.5) is None
    assert not epipolar_agreement((left, right), PAIR.cameras, 1.5).any()
    assert epipolar_matrix(tuple(image(part) for part in homologous(40)), PAIR.cameras, 1.5) is not None


@pytest.mark.parametrize(("good", "bad", "expected"), [(16, 0, True), (15, 0, False), (40, 60, True), (30, 100, False)])
def test_pairs_are_accepted_by_the_rule_of_brown_and_lowe(good, bad, expected):
    """n_inliers >= 8 + 0.3 n, and sixteen at least."""
    left, right = homologous(good + bad, seed=4)
    right[good:] = np.random.default_rng(5).uniform([0, 0], [1000, 800], (bad, 2))
    matches, summary = accepted(left, right)
    assert summary.accepted is expected and summary.tentative == good + bad
    assert len(matches) == summary.inliers
    if expected:
        assert np.isin(np.arange(good), matches.left).mean() > 0.9


def test_a_repeated_picture_is_alike_and_not_accepted():
    left, _ = homologous(60)
    matches, summary = accepted(left, left + 0.3)
    assert summary.alike and not summary.accepted and len(matches) == 0


@settings(max_examples=30, deadline=None)
@given(moved=st.floats(0.0, 1.0), seed=st.integers(0, 99))
def test_seven_tenths_of_the_points_decide_about_parallax(moved, seed):
    rng = np.random.default_rng(seed)
    here = rng.uniform(0, 1000, (200, 2))
    there = here.copy()
    count = round(200 * moved)
    there[:count] += 9.0
    assert without_parallax((here, there)) == (200 - count > 140)


@pytest.mark.parametrize("sigma", [0.1, 0.5])
def test_scatter_is_the_standard_error_of_the_other_point(sigma):
    left, right = homologous(500)
    noisy = right + np.random.default_rng(6).normal(0, sigma, right.shape)
    scatter = epipolar_scatter((left, noisy), PAIR.cameras)
    assert scatter.points == 500 and scatter.sigma == pytest.approx(sigma, rel=0.2)
    swapped = epipolar_scatter((noisy, left), PAIR.cameras)
    assert swapped.sigma == pytest.approx(scatter.sigma, rel=0.1)


@pytest.mark.parametrize(("count", "known"), [(59, False), (60, True)])
def test_sixty_points_are_needed_for_a_scatter(count, known):
    assert (epipolar_scatter(homologous(count), PAIR.cameras).sigma is not None) is known


def test_summaries_name_both_photographs():
    assert accepted(*homologous(40)).summary == PairSummary(left="a", right="b", tentative=40, inliers=40)


def placed(*places, attitude=None) -> list[Photo]:
    facts = {"width": 10, "height": 10, "bands": 1, "dtype": "uint8", "camera": "c", "attitude": attitude}
    return [Photo(name=f"p{n}", path="", position=place, **facts) for n, place in enumerate(places)]


ROW = tuple((50.0 * n, 0.0, 200.0) for n in range(6))


def test_vertical_photographs_view_the_ground_below_them():
    assert np.array_equal(viewed_ground(placed(*ROW)), np.array(ROW)[:, :2])
    assert np.allclose(viewed_ground(placed(*ROW, attitude=(0.0, 0.0, 77.0))), np.array(ROW)[:, :2])


@pytest.mark.parametrize(("tilt", "moved"), [(30.0, 150.0 * np.tan(np.radians(30.0))), (89.0, 450.0), (100.0, 450.0)])
def test_oblique_photographs_view_ground_three_spacings_below(tilt, moved):
    """50 m spacing stands for 150 m of flying height; the axis is not followed farther than three times that."""
    ground = viewed_ground(placed(*ROW, attitude=(tilt, 0.0, 0.0)))
    assert np.allclose(np.linalg.norm(ground - np.array(ROW)[:, :2], axis=1), moved, rtol=1e-6)


@settings(max_examples=25, deadline=None)
@given(count=st.integers(2, 40), nearest=st.integers(2, 8), limit=st.integers(2, 20), seed=st.integers(0, 50))
def test_candidate_pairs_are_sorted_unique_and_as_many_as_allowed(count, nearest, limit, seed):
    rng = np.random.default_rng(seed)
    shown = Photos(photos=tuple(placed(*(tuple(place) for place in rng.uniform(0, 500, (count, 3)).tolist()))))
    pairs = candidate_pairs(shown, Neighbourhood(limit, nearest))
    assert list(pairs) == sorted(set(pairs)) and all(0 <= left < right < count for left, right in pairs)
    assert {(i, i + 1) for i in range(count - 1)} <= set(pairs), "neighbours in sequence are always compared"
    assert len(pairs) == count * (count - 1) // 2 if count <= limit else len(pairs) <= count * (nearest + 2)
