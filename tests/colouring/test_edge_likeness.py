"""Which surface the photographs show: by their colours at both heights, beside a plain NumPy twin."""

import numpy as np
import pytest

from orthomill.schemas.raster import Window
from orthomill.tasks.colouring.edges.likeness import OTHER, REACH, SPREAD, Examples, Side, likeness, spacing_of, supported

ROOF, GRASS, FACADE = np.array([200.0, 40.0, 40.0]), np.array([90.0, 120.0, 80.0]), np.array([230.0, 0.0, 230.0])
SHADOW = np.array([30.0, 35.0, 25.0])
DIVISOR = 2
SPACING = 4
SIDES = np.where(np.arange(40) < 20, Side.LOWER, Side.UPPER).astype(np.uint8)[None, :].repeat(40, 0)
EXAMPLES = np.where(SIDES[..., None] == Side.UPPER, ROOF, GRASS).astype(np.float32)
"""ground on the left, a roof on the right"""


def one(upper: list[np.ndarray], lower: list[np.ndarray], shown=None, sides=SIDES, examples=EXAMPLES):
    """Score and likenesses (2, photos) of a single pixel at the node in row 18, column 19 of the examples."""
    colours = [np.array(values, np.float32)[:, None, None, :] for values in (upper, lower)]
    seen = np.ones((len(upper), 1, 1), bool) if shown is None else np.array(shown)[:, None, None]
    pixel = Window(18 * SPACING, 19 * SPACING, 1, 1)
    found = likeness(*colours, seen, Examples(examples, sides, (0, 0), SPACING), np.ones((1, 1), bool), pixel, DIVISOR)
    return found.score[0, 0], found.alike[..., 0, 0]


def test_a_roof_in_all_photographs_is_a_roof():
    score, alike = one([ROOF, ROOF, ROOF], [ROOF, ROOF, ROOF])
    assert score < -10 and alike[Side.UPPER - 1].all() and not alike[Side.LOWER - 1].any()


def test_ground_that_half_of_the_photographs_see_is_ground():
    """One photo sees the ground beside the wall, from the other the roof hides it; at the roof's height they see what is behind."""
    score, alike = one([GRASS, FACADE], [GRASS, ROOF])
    assert score > 10 and alike[Side.LOWER - 1].tolist() == [True, False]


def test_ground_in_a_shadow_that_is_like_nothing_around_is_shown_by_photographs_that_do_not_show_the_roof():
    assert one([GRASS, SHADOW, GRASS], [SHADOW, ROOF, SHADOW])[1][Side.LOWER - 1].tolist() == [True, False, True]


def test_a_photograph_in_which_shadow_and_roof_mix_to_the_colour_of_ground_does_not_outvote_two_that_show_the_shadow():
    assert one([GRASS] * 4, [GRASS, SHADOW, SHADOW, ROOF])[1][Side.LOWER - 1].tolist() == [False, True, True, False]


def test_where_a_photograph_shows_the_ground_another_that_shows_a_wall_does_not():
    assert one([GRASS, FACADE, GRASS], [GRASS, FACADE, ROOF])[1][Side.LOWER - 1].tolist() == [True, False, False]


def test_a_photograph_that_does_not_show_the_pixel_has_no_say():
    with_it, without = one([ROOF, GRASS], [GRASS, GRASS], [True, False]), one([ROOF], [GRASS])
    assert with_it[0] == without[0] and not with_it[1][:, 1].any()


def test_a_photograph_is_like_both_surfaces_where_they_look_the_same():
    """Roof and ground of nearly one colour: noise must not choose the photographs pixel by pixel."""
    alike_colours = np.where(SIDES[..., None] == Side.UPPER, GRASS + 3.0, GRASS).astype(np.float32)
    _, alike = one([GRASS], [GRASS + 3.0], examples=alike_colours)
    assert alike.all()


@pytest.mark.parametrize("only", [Side.UPPER, Side.LOWER])
def test_without_examples_of_both_surfaces_the_photographs_cannot_tell(only):
    score, alike = one([ROOF], [GRASS], sides=np.full_like(SIDES, only))
    assert np.isnan(score) and not alike.any()


def score_by_numpy(upper, lower, shown, examples: Examples, place, divisor) -> float:
    """`place`: row and column in the orthoimage."""
    cell = [n // divisor * divisor + (divisor - 1) // 2 for n in place]
    rows, cols = ((np.arange(n) + first) * examples.spacing for n, first in zip(examples.sides.shape, examples.first, strict=True))
    near = (abs(rows - cell[0]) <= REACH * divisor)[:, None] & (abs(cols - cell[1]) <= REACH * divisor)
    highs, lows = (examples.colours[near & (examples.sides == side)] for side in (Side.UPPER, Side.LOWER))

    def distance(colour, others):
        return min(OTHER, np.abs(np.array(others, float) - colour).mean(axis=1).min())

    photos = np.flatnonzero(shown)
    own, other = (np.mean([distance(upper[p], those) for p in photos]) for those in (highs, lows))
    low = sorted(distance(lower[p], lows) for p in photos)
    return 2 * own - other - np.mean(low[: (len(low) + 1) // 2])


@pytest.mark.parametrize(("bands", "divisor"), [(1, 1), (3, 2), (3, 3)])
def test_scores_agree_with_numpy(bands, divisor):
    rng = np.random.default_rng(bands)
    sides = rng.integers(0, 3, (30, 30)).astype(np.uint8)
    examples = Examples(rng.uniform(0, 255, (30, 30, bands)).astype(np.float32), sides, (5, 7), spacing_of(divisor))
    upper, lower = rng.uniform(0, 255, (2, 5, 4, 6, bands)).astype(np.float32)
    shown, chosen = rng.random((5, 4, 6)) < 0.7, rng.random((4, 6)) < 0.8
    shown[0] = True
    window = Window(8 * examples.spacing + 1, 30 * examples.spacing + 1, 4, 6)
    found = likeness(upper, lower, shown, examples, chosen, window, divisor).score
    assert (np.isfinite(found) == chosen).all()
    for r, c in zip(*np.nonzero(chosen), strict=True):
        place = (window.row + r, window.col + c)
        expected = score_by_numpy(upper[:, r, c], lower[:, r, c], shown[:, r, c], examples, place, divisor)
        assert found[r, c] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("divisor", [1, 2, 3, 5, 8])
def test_examples_are_as_dense_as_asked_and_no_denser(divisor):
    along = 2 * REACH * divisor // spacing_of(divisor) + 1
    assert SPREAD <= along < 2 * SPREAD


def test_pixels_that_look_alike_support_each_other():
    """A wrong score in the middle of the roof is outvoted, the outline of the roof stays where it is."""
    scores = np.where(np.arange(12) < 6, 20.0, -20.0).astype(np.float32)[None, :].repeat(12, 0)
    scores[6, 9] = 5.0
    colours = np.where(scores[..., None] > 10, GRASS, ROOF).astype(np.float32)
    found = supported(scores, colours, colours, 2)
    np.testing.assert_array_equal(found < 0, np.arange(12)[None, :].repeat(12, 0) >= 6)


def test_support_agrees_with_numpy_and_leaves_gaps():
    rng = np.random.default_rng(7)
    scores = rng.normal(0, 20, (9, 9)).astype(np.float32)
    scores[rng.random((9, 9)) < 0.2] = np.nan
    upper, lower = rng.uniform(100, 110, (2, 9, 9, 3)).astype(np.float32)
    found = supported(scores, upper, lower, 1)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(scores))
    for r, c in zip(*np.nonzero(np.isfinite(scores)), strict=True):
        near = np.s_[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2]
        apart = sum(np.abs(guide[near] - guide[r, c]).sum(axis=-1) for guide in (upper, lower))
        weight = np.where(np.isnan(scores[near]), 0, np.exp(-apart / 30.0))
        assert found[r, c] == pytest.approx((weight * np.nan_to_num(scores[near])).sum() / weight.sum(), abs=1e-4)
