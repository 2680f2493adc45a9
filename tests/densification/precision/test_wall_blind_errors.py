"""Standard errors among neighbours of windows that know no walls, on surfaces that can be written down."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.wall_blind_errors import wall_blind_precision, window_doubt
from orthomill.tasks.densification.volume.quality import Judgement

SIGMA, WINDOW = 0.1, 13
STATED = SIGMA * np.hypot(1.0, 0.4)
"""m: with what all pairs have in common"""
WALL = 40
"""first column of the roof"""


def wall() -> np.ndarray:
    """Ground at 10 m, a roof at 16 m."""
    height = np.full((60, 80), 10.0, np.float32)
    height[:, WALL:] = 16.0
    return height


def rated(height: np.ndarray, distinctiveness: float = 1.0, pairs: int = 1, window: int = WINDOW) -> np.ndarray:
    volume = VolumeWindow.unknown(height.shape)
    volume.judgement[..., Judgement.DISTINCTIVENESS] = 100 * distinctiveness
    codes, count = np.full(height.shape, Provenance.AGREED, np.uint8), np.full(height.shape, pairs, np.uint8)
    return wall_blind_precision(FusedCells(height, np.full(height.shape, SIGMA, np.float32), count, codes), volume, window)


def test_on_even_ground_matching_says_all():
    slope = (0.5 * np.add.outer(np.arange(60), np.arange(80))).astype(np.float32)
    inner = slice(12, -12), slice(12, -12)
    assert rated(slope, 2.0)[inner] == pytest.approx(STATED, rel=1e-3)
    assert rated(slope, 2.0, pairs=4)[inner] == pytest.approx(SIGMA * np.hypot(1.0, 0.4 * 2), rel=1e-3)
    assert np.isnan(rated(np.full((9, 9), np.nan, np.float32))).all()


def test_the_doubt_about_a_wall_falls_with_its_distance_and_ends_where_no_window_reaches():
    found = rated(wall(), 2.0)[30]
    ground, roof = found[:WALL][::-1], found[WALL:]
    # Half a window of 13 cells, and two for a wall that is shown half a window off.
    for side in (ground, roof):
        assert (np.diff(side[:9]) <= 0).all() and side[0] > 5 * STATED and side[8:] == pytest.approx(STATED, rel=1e-3)
    assert (found <= 6.1).all() and (roof[:6] > ground[:6]).all(), "the higher side fills most windows"


def test_a_wider_window_doubts_more_of_the_ground():
    doubts = [(window_doubt(wall(), window) > 0.05).sum() for window in (1, 5, 13, 25)]
    assert doubts[0] == 0 and (np.diff(doubts) > 0).all()


def test_a_step_between_what_is_higher_and_what_is_lower_is_doubted_most():
    stairs = wall()
    stairs[:, WALL : WALL + 3] = 13.0
    found = window_doubt(stairs, WINDOW)[30]
    assert found[WALL + 1] > 0.15 * 3.0 and found[WALL + 1] > found[WALL - 1]


def test_rivals_that_are_beaten_less_clearly_make_a_wall_more_doubtful_and_nothing_else():
    clear, doubtful = rated(wall(), 1.0), rated(wall(), 0.2)
    assert (doubtful[:, WALL - 2 : WALL + 2] > clear[:, WALL - 2 : WALL + 2] + 0.1).all()
    assert np.array_equal(doubtful[:, :20], clear[:, :20])


def test_uneven_heights_are_doubtful():
    rough = 10 + np.random.default_rng(5).normal(0, 0.1, (60, 80))
    assert (rated(rough.astype(np.float32), 2.0, window=1) > 2 * STATED).mean() > 0.8


def test_an_even_slope_is_no_doubt():
    slope = (0.5 * np.add.outer(np.arange(30), np.arange(30))).astype(np.float32)
    assert (window_doubt(slope, 4)[6:-6, 6:-6] < 1e-3).all()


def test_a_wall_is_doubted_more_where_much_was_not_found():
    holes = np.where(np.indices((60, 80)).sum(axis=0) % 2, np.float32(np.nan), wall())
    found, whole = (window_doubt(height, WINDOW)[20:40, WALL - 7 : WALL + 7] for height in (holes, wall()))
    known = np.isfinite(holes[20:40, WALL - 7 : WALL + 7])
    # Where half a window away something is 6 m higher or lower: 0.07 of that.
    assert found[known].min() > 0.4 and (found[known] >= whole[known]).all() and (found[~known] == 0).all()
