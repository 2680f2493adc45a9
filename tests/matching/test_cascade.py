"""Matching in steps on a part of the published pair: better than its first step, better than its last one alone."""

import numpy as np
import pytest

from schemas.outcome import Outcome
from schemas.raster import Window
from tasks.matching.least_squares.matching import match_points
from tasks.matching.strategies.cascade import CascadeMatching, match_cascade
from tasks.simulation.dissertation_pair import PairCrop, ground_texture, pair_crop
from tasks.simulation.dissertation_surface import true_matches

CASCADE = CascadeMatching()


@pytest.fixture(scope="module")
def crop() -> PairCrop:
    return pair_crop(ground_texture(), Window(5200, 6000, 460, 480), 40)


@pytest.fixture(scope="module")
def start_list(crop) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, starts and truth in pixels of the crop."""
    cols, rows = np.meshgrid(np.arange(20.0, 460.0, 9), np.arange(20.0, 440.0, 9))
    points = np.column_stack([cols.ravel(), rows.ravel()])
    truth = true_matches(points + crop.left_origin) - crop.right_origin
    return points, truth + np.random.default_rng(3).normal(size=truth.shape) * [1.5, 0.5], truth


def correct(found, truth) -> np.ndarray:
    return found.converged & (np.abs(found.position - truth) < 0.5).all(axis=1)


def rms(found, truth) -> float:
    return float(np.sqrt(((found.col - truth[:, 0])[correct(found, truth)] ** 2).mean()))


def test_the_steps_together_beat_each_alone(crop, start_list):
    points, starts, truth = start_list
    both = match_cascade(crop.left, crop.right, points, starts, CASCADE)
    first, last = (match_points(crop.left, crop.right, points, starts, step) for step in CASCADE.steps)
    assert correct(both, truth).mean() > 0.975
    assert (both.converged & ~correct(both, truth)).sum() <= (last.converged & ~correct(last, truth)).sum()
    assert rms(both, truth) < 0.8 * rms(first, truth)


def test_one_step_is_plain_matching(crop, start_list):
    points, starts, _ = start_list
    step = CASCADE.steps[0]
    one = match_cascade(crop.left, crop.right, points[:50], starts[:50], CascadeMatching(steps=(step,)))
    plain = match_points(crop.left, crop.right, points[:50], starts[:50], step)
    assert np.array_equal(one.position, plain.position, equal_nan=True)


def test_a_point_that_a_step_loses_keeps_the_outcome_of_that_step(crop, start_list):
    points, starts, _ = start_list
    starts = starts[:4].copy()
    starts[0], starts[1] = np.nan, -500.0
    strict = CASCADE.steps[1].model_copy(update={"min_gradient": 200.0})
    found = match_cascade(crop.left, crop.right, points[:4], starts, CascadeMatching(steps=(CASCADE.steps[0], strict)))
    assert found.outcome.tolist() == [Outcome.OUTSIDE, Outcome.OUTSIDE, Outcome.LOW_TEXTURE, Outcome.LOW_TEXTURE]
    assert np.isnan(found.position).all()
    assert found.half.tolist() == [13, 13, 10, 10]


def test_an_empty_list_gives_an_empty_answer(crop):
    assert len(match_cascade(crop.left, crop.right, np.empty((0, 2)), np.empty((0, 2)), CASCADE)) == 0


def test_a_cascade_has_at_least_one_step():
    with pytest.raises(ValueError, match="steps"):
        CascadeMatching(steps=())
