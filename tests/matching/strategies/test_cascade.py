"""Matching in steps on a part of the published pair: better than its first step, better than its last one alone."""

import numpy as np
import pytest

from benchmarks.matching.dissertation_pair import PairCrop, ground_texture, pair_crop
from benchmarks.matching.dissertation_surface import true_matches
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.least_squares.matching import match_points
from orthomill.tasks.matching.strategies.cascade import match_cascade
from orthomill.tasks.matching.strategies.cascade_settings import CascadeMatching

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
    first, last = (match_points(crop.left, crop.right, points, starts, step) for step in (CASCADE.find, CASCADE.sharpen))
    assert correct(both, truth).mean() > 0.975
    assert (both.converged & ~correct(both, truth)).sum() <= (last.converged & ~correct(last, truth)).sum()
    assert rms(both, truth) < 0.8 * rms(first, truth)


def test_clean_points_are_measured_with_the_small_window_and_noisy_ones_with_the_large(crop, start_list):
    points, starts, _ = start_list
    noise = np.random.default_rng(5).normal(0.0, 20.0, crop.right.shape)
    noisy = np.clip(np.rint(crop.right + noise), 1, 255).astype(np.uint8)
    sizes = [match_cascade(crop.left, right, points, starts, CASCADE) for right in (crop.right, noisy)]
    clean, disturbed = (2 * found.half[found.converged] + 1 for found in sizes)
    assert (clean == CASCADE.sharpen.window).mean() > 0.9
    assert (disturbed == CASCADE.measure.window).mean() > 0.7


def test_a_point_worse_than_asked_for_is_not_returned(crop, start_list):
    points, starts, _ = start_list
    found = match_cascade(crop.left, crop.right, points, starts, CASCADE)
    limit = float(np.median(found.sigma[found.converged]))
    strict = match_cascade(crop.left, crop.right, points, starts, CASCADE.model_copy(update={"max_sigma": limit}))
    refused = strict.outcome == Outcome.IMPRECISE
    assert np.array_equal(refused, found.converged & (found.sigma > limit))
    assert np.isnan(strict.position[refused]).all()


def test_a_point_that_a_step_loses_keeps_the_outcome_of_that_step(crop, start_list):
    points, starts, _ = start_list
    starts = starts[:4].copy()
    starts[0], starts[1] = np.nan, -500.0
    strict = CASCADE.measure.model_copy(update={"min_gradient": 200.0, "window": 21})
    found = match_cascade(crop.left, crop.right, points[:4], starts, CASCADE.model_copy(update={"measure": strict}))
    assert found.outcome.tolist() == [Outcome.OUTSIDE, Outcome.OUTSIDE, Outcome.LOW_TEXTURE, Outcome.LOW_TEXTURE]
    assert np.isnan(found.position).all()
    assert found.half.tolist() == [13, 13, 10, 10]


def test_a_point_that_only_the_small_window_loses_keeps_the_large_ones_place(crop, start_list):
    points, starts, truth = start_list
    strict = CASCADE.sharpen.model_copy(update={"min_gradient": 200.0})
    found = match_cascade(crop.left, crop.right, points, starts, CASCADE.model_copy(update={"sharpen": strict}))
    assert correct(found, truth).mean() > 0.975
    assert set(found.half[found.converged]) == {CASCADE.measure.half}


def test_an_empty_list_gives_an_empty_answer(crop):
    assert len(match_cascade(crop.left, crop.right, np.empty((0, 2)), np.empty((0, 2)), CASCADE)) == 0
