"""Boards on a floor: sizes, corners and the seeded set-ups of the benchmarks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.calibration.board_setups import FIVE_BOARDS, PUBLISHED, SIX_BOARDS, floor_corners, places_of, views_of
from orthomill.tasks.simulation.boards.board_scene import BoardType

BOARD = BoardType((6, 5), 0.04, 0.02)


def test_corners_of_a_board_are_centred_and_listed_row_by_row():
    assert BOARD.local.shape == (30, 2) and BOARD.local.mean(axis=0) == pytest.approx([0.0, 0.0])
    assert BOARD.local[0] == pytest.approx([-0.1, -0.08]) and BOARD.local[1] - BOARD.local[0] == pytest.approx([0.04, 0.0])
    assert BOARD.local[6] - BOARD.local[0] == pytest.approx([0.0, 0.04])


def test_the_reach_is_half_the_diagonal_of_the_paper():
    assert BOARD.reach == pytest.approx(np.hypot(7 * 0.04 + 0.04, 6 * 0.04 + 0.04) / 2)


@settings(deadline=None, max_examples=30)
@given(x=st.floats(-2, 2), y=st.floats(-2, 2), angle=st.floats(-4, 4))
def test_boards_are_moved_but_not_deformed(x, y, angle):
    (corners,) = floor_corners(np.array([[x, y, angle]]), BOARD)
    assert (corners[:, 2] == 0).all() and corners.mean(axis=0) == pytest.approx([x, y, 0.0], abs=1e-12)
    along, down = corners[5, :2] - corners[0, :2], corners[24, :2] - corners[0, :2]
    assert np.hypot(*along) == pytest.approx(0.2) and np.hypot(*down) == pytest.approx(0.16)
    assert along[0] * down[1] - along[1] * down[0] > 0, "not mirrored"


@pytest.mark.parametrize("setup", PUBLISHED, ids=lambda setup: setup.name)
def test_boards_of_a_set_up_do_not_overlap(setup):
    places = places_of(setup)
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2) + 9.0 * np.eye(len(places))
    # Two boards cannot touch when their centres are farther apart than twice half their shorter side.
    assert len(places) == setup.boards and apart.min() > 1.7 * setup.board.reach


def test_every_photo_of_a_set_up_shows_all_its_boards():
    corners = floor_corners(places_of(SIX_BOARDS), SIX_BOARDS.board).reshape(-1, 3)
    views = views_of(SIX_BOARDS)
    assert len(views) == 14 and all(view.contains(view.project(corners)).all() for view in views)


def test_the_seed_alone_decides():
    one, two = views_of(SIX_BOARDS), views_of(replace(SIX_BOARDS, photos=5))
    assert all(np.array_equal(a.centre, b.centre) for a, b in zip(one[:5], two, strict=True))
    assert not np.array_equal(places_of(SIX_BOARDS), places_of(replace(SIX_BOARDS, seed=1)))


def test_tilts_turns_and_distances_are_those_of_the_set_up():
    setup = replace(FIVE_BOARDS, photos=4, tilt=(20.0, 21.0))
    tilts = [np.degrees(np.arccos(view.rotation[2, 2])) for view in views_of(setup)]
    assert min(tilts) > 19.0 and max(tilts) < 22.0
    kappa = [np.degrees(np.arctan2(view.rotation[0, 1], view.rotation[0, 0])) for view in views_of(replace(setup, turned=False))]
    assert max(np.abs(kappa)) < 20.0
    near, far = views_of(setup)[0], views_of(replace(setup, back=1.5))[0]
    assert far.centre[2] == pytest.approx(1.5 * near.centre[2]) and np.array_equal(far.rotation, near.rotation)


def test_straight_boards_are_where_rotated_ones_are():
    straight, rotated = places_of(replace(SIX_BOARDS, straight=True)), places_of(SIX_BOARDS)
    assert (straight[:, 2] == 0).all() and np.array_equal(straight[:, :2], rotated[:, :2]) and np.ptp(rotated[:, 2]) > 1.0


def test_a_smaller_share_of_the_boards_lets_the_camera_come_nearer():
    whole, some = views_of(SIX_BOARDS)[0], views_of(replace(SIX_BOARDS, share=0.5))[0]
    assert some.centre[2] < whole.centre[2]
