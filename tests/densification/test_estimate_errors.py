"""Standard errors of estimates: their distance to what was measured, and what knows nothing."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.estimate_errors import groundless, with_distance, with_shown
from orthomill.tasks.densification.precision.matched_ground import matched_ground
from orthomill.tasks.densification.precision.standard_errors import REACH
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.volume.quality import Judgement


def coded(provenance: np.ndarray) -> FusedCells:
    shape = provenance.shape
    return FusedCells(np.zeros(shape, np.float32), np.full(shape, 0.1, np.float32), np.zeros(shape, np.uint8), provenance)


def widened(codes: np.ndarray, cell: float, known: bool = False) -> FusedCells:
    return with_distance(coded(codes), cell, np.full(codes.shape, known))


def test_an_estimate_is_the_worse_the_farther_it_is_from_measured_ground():
    codes = np.full((21, 260), Provenance.AGREED, np.uint8)
    codes[:, 10:250] = Provenance.INCOHERENT
    found = widened(codes, 0.05).precision[10]
    assert (found[:10] == np.float32(0.1)).all() and found[10] > 0.1
    assert (np.diff(found[10:70]) > 0).all() and found[75:180] == pytest.approx(found[80]) and 6 < found[80] < 8


def test_no_estimate_is_worse_than_things_are_high():
    codes = np.full((21, 260), Provenance.AGREED, np.uint8)
    codes[:, 10:250] = Provenance.INTERPOLATED
    assert widened(codes, 5.0).precision.max() == pytest.approx(10.0, rel=1e-3)


def test_single_measured_cells_in_a_crown_make_no_ground():
    codes = np.full((31, 31), Provenance.AGREED, np.uint8)
    codes[8:23, 8:23] = Provenance.INCOHERENT
    around = widened(codes, 1.0).precision[15, 14]
    codes[15, 15] = Provenance.AGREED
    assert widened(codes, 1.0).precision[15, 14] == around
    assert widened(codes, 1.0).precision[15, 15] == np.float32(0.1)


def test_what_a_cell_knows_itself_no_distance_overrides():
    codes = np.full((5, 60), Provenance.COARSE, np.uint8)
    codes[:, 20:40], codes[:, 40:] = Provenance.INCOHERENT, Provenance.INTERPOLATED
    knowing, guessing = (widened(codes, 1.0, known).precision[2] for known in (True, False))
    assert (knowing[:40] == np.float32(0.1)).all() and (guessing[:20] == np.float32(0.1)).all()
    assert (guessing[20:] > 1).all() and (knowing[40:] > 1).all()


def test_without_any_measured_cell_every_estimate_is_a_far_one():
    codes = np.full((5, 5), Provenance.INTERPOLATED, np.uint8)
    assert (widened(codes, 1.0).precision >= 10).all()


def test_estimates_far_below_the_ground_around_and_too_uncertain_to_be_trees_are_groundless():
    height = np.full((9, 60), 90.0, np.float32)
    code = np.full(height.shape, Provenance.AGREED, np.uint8)
    code[:, 8:] = Provenance.INCOHERENT
    precision = np.full(height.shape, 20.0, np.float32)
    height[:, 8:], height[:, 20] = -30.0, 95.0
    precision[:, 10] = 5.0
    found = groundless(FusedCells(height, precision, np.ones(height.shape, np.uint8), code))[4]
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
    return with_shown(cells, volume, matched_ground(cells, 1.0))


@pytest.mark.parametrize(
    ("count", "coherence", "beside", "shown"),
    [(1, 80, 9.0, True), (1, 20, 0.0, True), (1, 20, 9.0, False), (0, 80, 0.0, True), (0, 80, 9.0, False), (0, 59, 0.0, False)],
)
def test_estimates_of_which_photographs_say_something_are_told_from_guesses(count, coherence, beside, shown):
    found = estimates(count, coherence, beside)
    assert (found.provenance[12, 12] == Provenance.COARSE) == shown
    assert found.precision[12, 12] == pytest.approx(np.hypot(0.1, 0.6) if shown and not count else 0.1)
    assert estimates(0, 100, 0.0).precision[12, 12] == pytest.approx(np.hypot(0.1, 0.4))
