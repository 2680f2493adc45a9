"""Pull and push: means of what is known, gaps closed smoothly."""

import numpy as np

from orthomill.tasks.imagery.pull_push import doubled, filled, halved


def test_means_are_of_the_known_values():
    values = np.array([[1.0, np.nan, 5.0], [2.0, 3.0, np.nan], [np.nan, np.nan, np.nan]], np.float32)
    np.testing.assert_array_equal(halved(values), np.array([[2.0, 5.0], [np.nan, np.nan]], np.float32))


def test_doubling_a_ramp_gives_the_ramp_between_the_outer_blocks():
    coarse = np.arange(4.0)[None, :].repeat(3, axis=0)
    np.testing.assert_allclose(doubled(coarse, (6, 8))[2, 1:-1], np.arange(1, 7) / 2 - 0.25)


def test_what_is_known_stays_and_every_gap_is_closed_between_the_values():
    values = np.full((13, 21), np.nan, np.float32)
    values[0, 0], values[12, 20], values[5, 7] = 1.0, 3.0, 2.0
    closed = filled(values)
    assert (closed[0, 0], closed[12, 20], closed[5, 7]) == (1.0, 3.0, 2.0)
    assert closed.min() >= 1.0 and closed.max() <= 3.0


def test_without_any_value_nothing_is_closed():
    assert np.isnan(filled(np.full((3, 5), np.nan))).all()
