"""How far photographs agree about a roof, beside a plain NumPy twin."""

from itertools import combinations

import numpy as np
import pytest

from orthomill.tasks.colouring.edges.agreement import USUAL, disagreement, with_agreement

EVERYWHERE = np.ones((1, 1), bool)


def of_one(*greys: float, shown=None) -> float:
    """The disagreement of photographs that show a single grey pixel."""
    colours = np.array(greys, np.float32)[:, None, None, None]
    seen = np.ones((len(greys), 1, 1), bool) if shown is None else np.array(shown)[:, None, None]
    return float(disagreement(colours, seen, EVERYWHERE)[0, 0])


def by_numpy(colours: np.ndarray) -> float:
    """Of colours (photos, bands)."""
    apart = sorted(np.abs(a - b).mean() for a, b in combinations(colours, 2))
    return float(np.mean(apart[: (len(apart) + 1) // 2]))


@pytest.mark.parametrize("bands", [1, 3])
def test_disagreement_is_that_of_the_better_half_of_the_pairs(bands):
    rng = np.random.default_rng(bands)
    colours, shown = rng.uniform(0, 255, (6, 4, 5, bands)).astype(np.float32), rng.random((6, 4, 5)) < 0.6
    chosen = rng.random((4, 5)) < 0.8
    found = disagreement(colours, shown, chosen)
    np.testing.assert_array_equal(np.isfinite(found), chosen & (shown.sum(axis=0) >= 2))
    for r, c in zip(*np.nonzero(np.isfinite(found)), strict=True):
        assert found[r, c] == pytest.approx(by_numpy(colours[shown[:, r, c], r, c]), abs=1e-3)


def test_what_stands_before_the_roof_in_one_photograph_does_not_count():
    assert of_one(100, 101, 102, 250) < 2 < of_one(100, 150, 200, 250)


def test_of_many_photographs_some_are_compared_from_first_to_last():
    """Twenty in two groups of ten that differ: were only the first compared, they would agree."""
    assert of_one(*[0] * 8, *[60] * 8, *[120] * 9) > 10


def test_one_photograph_cannot_disagree():
    assert np.isnan(of_one(100, 200, shown=[True, False]))
    score = np.array([[-4.0]], np.float32)
    assert with_agreement(score, np.array([[np.nan]], np.float32)) == score


def test_a_wall_that_looks_like_the_roof_is_none():
    """By their colours photographs would call it a roof, but they show different places of it."""
    scores = np.full((1, 2), -12.0, np.float32)
    roof, wall = with_agreement(scores, np.array([[2.0, 18.0]], np.float32))[0]
    assert roof < -12.0 and wall > 0


def test_a_roof_that_looks_like_the_ground_is_one():
    assert with_agreement(np.array([[1.0]], np.float32), np.array([[USUAL - 3]], np.float32)) < 0


def test_no_likeness_outweighs_photographs_that_differ():
    assert with_agreement(np.array([[-60.0]], np.float32), np.array([[20.0]], np.float32)) > 0
