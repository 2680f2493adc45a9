"""Standard errors of estimates: what was measured around them, and what knows nothing."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.estimate_errors import groundless, with_shown, with_surroundings
from orthomill.tasks.densification.precision.matched_ground import matched_ground
from orthomill.tasks.densification.precision.standard_errors import REACH
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.volume.quality import Judgement


def guessed(height: np.ndarray, code: np.ndarray, alone: bool = False) -> np.ndarray:
    """Standard errors of heights (rows, cols) m with codes of Provenance, of which what was measured is good to 0.1 m."""
    shape = height.shape
    cells = FusedCells(height.astype(np.float32), np.full(shape, 0.1, np.float32), np.zeros(shape, np.uint8), code)
    return with_surroundings(cells, np.full(shape, alone), 1.0).precision


def gap(rows: slice, cols: slice, guess: Provenance = Provenance.INCOHERENT) -> np.ndarray:
    """Codes of measured cells with guesses among them."""
    codes = np.full((41, 61), Provenance.AGREED, np.uint8)
    codes[rows, cols] = guess
    return codes


GAP = slice(15, 26), slice(20, 41)


@pytest.mark.parametrize("guess", [Provenance.INCOHERENT, Provenance.INTERPOLATED])
def test_a_guess_amid_smooth_ground_is_as_good_as_the_ground_is(guess):
    codes = gap(*GAP, guess)
    assert guessed(np.full(codes.shape, 7.0), codes) == pytest.approx(0.1)


def test_a_guess_is_compared_with_the_nearest_heights_in_eight_directions():
    codes, height = gap(*GAP), np.zeros((41, 61))
    height[:, 41:] = 8.0
    found = guessed(height, codes)
    # Of the middle of the gap only the east is behind its end: diagonals meet heights above and below it.
    assert found[20, 30] == pytest.approx(np.hypot(8.0 / np.sqrt(8), 0.1))
    height[:, 42:] = -50.0
    assert guessed(height, codes)[20, 30] == found[20, 30]


def test_a_guess_is_as_wrong_as_it_may_stand_off_what_was_measured_around():
    codes, height = gap(*GAP), np.zeros((41, 61))
    height[20, 30] = 8.0
    found = guessed(height, codes)
    assert found[20, 30] == pytest.approx(np.hypot(8.0, 0.1)) and found[20, 31] == pytest.approx(0.1)


def test_a_guess_between_a_roof_and_a_street_may_be_either():
    codes, height = gap(slice(None), slice(20, 41)), np.zeros((41, 61))
    height[:, 30:] = 6.0
    found = guessed(height, codes)[20]
    # Above and below there are guesses alone: left is the street, right is the roof.
    assert found[21:40] == pytest.approx(np.hypot(6.0 / np.sqrt(2), 0.1), rel=0.3) and (found[20:41] > 2.9).all()


def test_what_the_best_around_is_worth_bounds_a_guess():
    codes, precision = gap(*GAP), np.full((41, 61), 0.5, np.float32)
    precision[:, :20] = 0.02
    cells = FusedCells(np.zeros(codes.shape, np.float32), precision, np.zeros(codes.shape, np.uint8), codes)
    found = with_surroundings(cells, np.zeros(codes.shape, bool), 1.0).precision
    assert found[20, 30] == pytest.approx(0.02) and found[5, 30] == np.float32(0.5)


def test_what_photographs_show_on_a_coarser_scale_is_no_guess():
    codes = np.full((5, 60), Provenance.COARSE, np.uint8)
    codes[:, 20:40], codes[:, 40:] = Provenance.INCOHERENT, Provenance.AGREED
    height = np.zeros(codes.shape)
    height[:, 40:] = 3.0
    found = guessed(height, codes)[2]
    assert (found[:20] == np.float32(0.1)).all() and (found[20:40] > 1).all() and (found[40:] == np.float32(0.1)).all()


def test_a_guess_that_nothing_measured_is_near_is_as_uncertain_as_things_are_high():
    codes = np.full((5, 200), Provenance.INTERPOLATED, np.uint8)
    assert guessed(np.zeros(codes.shape), codes) == pytest.approx(10.0, rel=1e-3)
    # What was made of coarser levels knows itself how uncertain it is; what was interpolated among such heights does not.
    assert guessed(np.zeros(codes.shape), codes, True) == pytest.approx(10.0, rel=1e-3)
    assert guessed(np.zeros(codes.shape), np.full_like(codes, Provenance.INCOHERENT), True) == pytest.approx(0.1)
    codes[:, 0] = Provenance.AGREED
    found = guessed(np.zeros(codes.shape), codes)[2]
    assert found[1:65] == pytest.approx(0.1) and found[65:] == pytest.approx(10.0, rel=1e-3)


def test_estimates_far_below_the_ground_around_and_too_uncertain_to_be_trees_are_groundless():
    height = np.full((9, 60), 90.0, np.float32)
    code = np.full(height.shape, Provenance.AGREED, np.uint8)
    code[:, 8:] = Provenance.INCOHERENT
    precision = np.full(height.shape, 20.0, np.float32)
    height[:, 8:], height[:, 20] = -30.0, 95.0
    precision[:, 10] = 5.0
    found = groundless(FusedCells(height, precision, np.ones(height.shape, np.uint8), code), 1.0)[4]
    near = np.arange(60) < 8 + REACH
    # Not the ground itself, what is certain enough, what lies within trees' height of the ground, or what has no ground around.
    expected = near & (np.arange(60) >= 8) & ~np.isin(np.arange(60), (10, 20))
    assert np.array_equal(found, expected)


SHAPE = (24, 24)


def estimates(count: int, coherence: int, beside: float) -> FusedCells:
    """Estimates on level ground with the surface `beside` m higher from the middle on, after what is known of them is told."""
    height = np.full(SHAPE, 10.0, np.float32)
    height[:, 12:] += np.float32(beside)
    cells = FusedCells(
        height, np.full(SHAPE, 0.1, np.float32), np.full(SHAPE, count, np.uint8), np.full(SHAPE, Provenance.INCOHERENT, np.uint8)
    )
    judgement = np.zeros((*SHAPE, len(Judgement)), np.uint8)
    judgement[..., Judgement.COHERENCE] = coherence
    volume = VolumeWindow(height, judgement, np.full(SHAPE, Confidence.LOW, np.uint8))
    return with_shown(cells, volume, matched_ground(cells, 1.0, 1.0))


@pytest.mark.parametrize(
    ("count", "coherence", "beside", "shown"),
    [(1, 80, 9.0, True), (1, 20, 0.0, True), (1, 20, 9.0, False), (0, 80, 0.0, True), (0, 80, 9.0, False), (0, 59, 0.0, False)],
)
def test_estimates_of_which_photographs_say_something_are_told_from_guesses(count, coherence, beside, shown):
    found = estimates(count, coherence, beside)
    assert (found.provenance[12, 12] == Provenance.COARSE) == shown
    assert found.precision[12, 12] == pytest.approx(np.hypot(0.1, 0.6) if shown and not count else 0.1)
    assert estimates(0, 100, 0.0).precision[12, 12] == pytest.approx(np.hypot(0.1, 0.4))
