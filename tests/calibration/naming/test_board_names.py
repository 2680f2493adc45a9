"""Boards identified across photographs, initial values, and the published numbers of the method."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.calibration.board_setups import FIVE_BOARDS, PUBLISHED, SIX_BOARDS, TWELVE_BOARDS, BoardSetup, places_of, views_of
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.detection.homographies import applied, homography, moved, refined_together, rigid_motion
from orthomill.tasks.calibration.naming.board_names import name_boards, plane_views
from orthomill.tasks.calibration.naming.board_views import in_plane, motion_in_plane
from orthomill.tasks.calibration.reporting.distortion_curve import balancing_change, displacement
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.initial_constant import constant_from_conic, constants, estimate
from orthomill.tasks.calibration.solving.initial_pose import pose_of_projection
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.simulation.boards.board_scene import floor_corners


def corners(setup: BoardSetup, noise: float = 0.3, seed: int = 0, missing: float = 0.0):
    """Target, corners per photo (B, N, 2) and their true numbers; boards in random order; but for the first photo, a share of
    them is left out, and two stay."""
    generator = np.random.default_rng(seed)
    target = CalibrationTarget((setup.camera.width, setup.camera.height), setup.board.corners, setup.board.square, setup.boards)
    floor, found, order = floor_corners(places_of(setup), setup.board), [], []
    for number, view in enumerate(views_of(setup)):
        pixels = view.project(floor.reshape(-1, 3)).reshape(*floor.shape[:2], 2)
        whole = np.flatnonzero(view.contains(pixels.reshape(-1, 2), 1.0).reshape(pixels.shape[:2]).all(axis=1))
        kept = generator.permutation(whole)[: max(2, round((1 - missing * (number > 0)) * len(whole)))]
        found.append(target.centred(pixels[kept] + generator.normal(0, noise, pixels[kept].shape)))
        order.append(kept)
    return target, found, order


def one_renumbering(photos, order: list[np.ndarray]) -> bool:
    """Whether all photos with certain names have named all their boards, by one renumbering."""
    pairs = {
        (int(n), int(t))
        for own, true in zip(photos, order, strict=True)
        if own.certain
        for n, t in zip(own.names, true, strict=True)
    }
    return min(n for n, _ in pairs) >= 0 and len(pairs) == len({n for n, _ in pairs}) == len({t for _, t in pairs})


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10**6), missing=st.sampled_from([0.0, 0.3, 0.5]), boards=st.integers(2, 7))
def test_boards_keep_their_names_in_any_order_and_when_some_are_missing(seed, missing, boards):
    setup = replace(SIX_BOARDS, seed=seed, boards=boards, photos=6)
    target, found, order = corners(setup, seed=seed, missing=missing)
    naming = name_boards(plane_views(found, target.local), target.local, 0)
    assert one_renumbering(naming.photos, order)


@pytest.mark.slow
def test_twelve_boards_are_named_and_the_middle_one_is_the_first():
    target, found, order = corners(TWELVE_BOARDS)
    naming = name_boards(plane_views(found, target.local), target.local, 12)
    assert one_renumbering(naming.photos, order)
    places = naming.places[:, :3, 3]
    off = np.linalg.norm(places - places.mean(axis=0), axis=1)
    assert off.argmin() == 0 and (np.diff(off) > -0.02).all()
    assert naming.places[0] == pytest.approx(np.eye(4), abs=1e-9)


def test_a_stranger_is_left_out_and_a_single_board_is_kept():
    target, found, _ = corners(FIVE_BOARDS)
    found[2] = np.concatenate([found[2], found[2][:1] * 0.4 + 900.0])
    found[5] = found[5][:1]
    naming = name_boards(plane_views(found, target.local), target.local, 5)
    assert naming.photos[2].names[-1] == -1 and (naming.photos[2].names[:-1] >= 0).all()
    assert naming.photos[5].names.tolist() == [0] and not naming.photos[5].certain
    with pytest.raises(GeometryError, match="No photograph shows"):
        name_boards(plane_views([np.empty((0, 20, 2))], target.local), target.local, 5)


@pytest.mark.slow
@pytest.mark.parametrize("setup", PUBLISHED, ids=lambda setup: setup.name)
def test_published_setups_are_calibrated(setup):
    target, found, _ = corners(setup, 0.4, 1)
    known = arrangement_of(found, target)
    sigma = np.sqrt(np.diag(known.result.interior_covariance))[:5]
    assert (np.abs(known.result.state.interior[:5] - setup.camera.interior[:5]) < 4 * sigma).all()
    assert known.iterations <= 6 and known.result.sigma0 == pytest.approx(0.4, rel=0.1)


def test_a_wide_lens_is_calibrated_from_homographies_that_know_nothing_of_it():
    camera = SIX_BOARDS.camera.model_copy(update={"c": 2100.0, "k1": -0.26, "k2": 0.08, "k3": 0.0})
    target, found, order = corners(replace(SIX_BOARDS, camera=camera), 0.3)
    known = arrangement_of(found, target)
    assert one_renumbering(known.naming.photos, order)
    assert known.result.state.interior[0] == pytest.approx(2100.0, abs=2.0)


C1 = (3686.66, 3039.03, 3255.84, 2767.17, 3828.43, 3782.84, 3659.10)
C2 = (3643.44, 3598.63, 3618.62, 3459.89, 3668.88, 3661.90, 3721.77)


def test_the_published_rule_gives_the_published_constant():
    known = estimate(np.array(C1), np.array(C2))
    assert known.c == pytest.approx(3652.67, abs=0.01)
    assert (known.sigma1, known.sigma2) == (pytest.approx(232.23, abs=0.02), pytest.approx(43.10, abs=0.02))
    assert not np.isfinite(estimate(np.array([np.nan]), np.array([np.nan])).c)


@settings(deadline=None)
@given(omega=st.floats(-0.6, 0.6), phi=st.floats(-0.6, 0.6), kappa=st.floats(-3.1, 3.1))
def test_constant_and_pose_follow_from_a_homography(omega, phi, kappa):
    c, R, centre = 3000.0, rotation_matrix(omega, phi, kappa), np.array([0.2, -0.1, 1.4])
    view = np.diag([-c, -c, 1.0]) @ np.column_stack([R, -R @ centre])
    rotation, place = pose_of_projection(view * 0.3, c)
    H = view[:, [0, 1, 3]] / view[2, 3]
    assert rotation == pytest.approx(R, abs=1e-9) and place == pytest.approx(centre, abs=1e-9)
    assert np.abs(H[2, 0] * H[2, 1]) < 1e-4 or constants(H)[0] == pytest.approx(c, rel=1e-7)
    assert np.hypot(*H[2, :2]) < 0.02 or constant_from_conic([H]) == pytest.approx(c, rel=1e-7)


def test_a_photo_straight_down_gives_no_constant():
    assert np.isnan(constants(np.diag([2000.0, 2000.0, 1.0]))).all()
    assert np.isnan(constant_from_conic([np.diag([2000.0, 2000.0, 1.0])]))


@settings(deadline=None)
@given(angle=st.floats(-3, 3), x=st.floats(-2, 2), y=st.floats(-2, 2))
def test_motions_in_the_plane_are_found(angle, x, y):
    points = np.array([[0, 0], [0.3, 0.1], [0.2, 0.5], [-0.4, 0.2]])
    motion = np.array([angle, x, y])
    assert rigid_motion(points, moved(motion, points)) == pytest.approx(motion, abs=1e-9)
    assert motion_in_plane(in_plane(motion)) == pytest.approx(motion, abs=1e-12)


def test_joint_refinement_finds_homography_and_motions():
    local = np.array([[0.04 * i, 0.04 * j] for j in range(4) for i in range(5)])
    motions = np.array([[0, 0, 0], [0.4, 0.3, 0.1], [-1.2, -0.2, 0.4]])
    H = np.array([[900.0, 80.0, 10.0], [-60.0, 950.0, -20.0], [0.2, -0.3, 1.0]])
    xy = np.array([applied(H, moved(motion, local)) for motion in motions])
    start = motions + np.array([[0, 0, 0], [0.03, 0.01, -0.01], [-0.02, 0.01, 0.01]])
    refined_H, refined = refined_together(homography(local, xy[0] + 0.3), start, local, xy)
    assert refined == pytest.approx(motions, abs=1e-5) and refined_H == pytest.approx(H, rel=1e-4, abs=1e-2)


@pytest.mark.parametrize(
    ("c", "k1", "k2", "size", "expected"),
    [
        (3619.4, -3.08e-10, 3.546e-17, (5472, 3648), 3617.5),
        (3687.5, 6.237e-10, -3.482e-17, (5472, 3648), 3694.9),
        (4195.2, -8.272e-9, 4.298e-16, (4912, 3264), 4096.9),
        (4938.2, -1.248e-9, 2.816e-16, (5184, 3456), 4941.6),
    ],
)
def test_balanced_curves_are_the_published_ones(c, k1, k2, size, expected):
    radius = 0.85 * 0.5 * np.hypot(*size)
    assert c + balancing_change(c, (k1 * c**2, k2 * c**4, 0.0), radius) == pytest.approx(expected, abs=0.1)


def test_published_distortion_at_2000_px():
    c = 4195.2
    assert displacement(np.array([2000.0]), c, (-8.272e-9 * c**2, 4.298e-16 * c**4, 0.0))[0] == pytest.approx(-52.42, abs=0.01)
