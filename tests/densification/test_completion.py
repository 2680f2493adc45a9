"""Where pairs have no height the volume has one, with a code; what the orientation adds is smooth and the same in every tile."""

import numpy as np
import pytest
from village_pair import LEVEL_GRID, level_pair

from orthomill.schemas.raster import Window
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow, completed
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.datum_precision import SPACING, datum_precision
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.volume.quality import LEVEL_UNIT, STRETCH_UNIT, Judgement


def cells_of(*heights: float) -> FusedCells:
    height = np.array([heights], np.float32)
    known = np.isfinite(height)
    return FusedCells(height, np.where(known, 0.1, np.nan).astype(np.float32), known.astype(np.uint8), known.astype(np.uint8))


def volume_of(heights, confidence) -> VolumeWindow:
    judgement = np.zeros((1, len(heights), len(Judgement)), np.uint8)
    return VolumeWindow(np.array([heights], np.float32), judgement, np.array([confidence], np.uint8))


def test_the_volume_gives_what_pairs_do_not():
    volume = volume_of(
        (5.2, 6.0, 7.0, np.nan, 8.0), (Confidence.HIGH, Confidence.HIGH, Confidence.LOW, Confidence.LOW, Confidence.CALMED)
    )
    found = completed(cells_of(5.0, np.nan, np.nan, np.nan, np.nan), volume, 1.0)
    assert found.height[0].tolist()[:3] == [5.0, 6.0, 7.0] and np.isnan(found.height[0, 3])
    codes = [Provenance.ONE_PAIR, Provenance.VOLUME, Provenance.INCOHERENT, Provenance.EMPTY, Provenance.INCOHERENT]
    assert found.provenance[0].tolist() == codes and found.count[0].tolist() == [1, 0, 0, 0, 0]
    assert volume.size[0].tolist() == [1, 1, 1, 1, 1]


def test_pairs_count_farther_from_a_height_of_narrow_bases_or_of_a_coarser_level():
    volume = volume_of((5.0, 5.0, 5.0), (Confidence.HIGH, Confidence.HIGH, Confidence.COARSE))
    volume.judgement[..., Judgement.STRETCH] = (0, 3.5 * STRETCH_UNIT, 3.5 * STRETCH_UNIT)
    volume.judgement[..., Judgement.LEVEL] = 3 * LEVEL_UNIT
    assert volume.size[0].tolist() == [1.0, 3.5, 8.0]


def test_where_leaves_stand_alone_the_coarser_level_counts_and_no_pair():
    found = completed(
        cells_of(5.0, 5.0, np.nan), volume_of((5.2, 5.2, 5.2), (Confidence.COARSE, Confidence.CALMED, Confidence.COARSE)), 1.0
    )
    assert found.provenance[0].tolist() == [Provenance.COARSE, Provenance.INCOHERENT, Provenance.COARSE]
    assert found.height[0] == pytest.approx(5.2) and np.isnan(found.precision).all() and not found.count.any()


def test_what_pairs_find_where_the_volume_is_not_sure_is_an_estimate():
    found = completed(cells_of(5.0, 5.0), volume_of((5.2, 5.2), (Confidence.HIGH, Confidence.LOW)), 1.0)
    assert found.provenance[0].tolist() == [Provenance.ONE_PAIR, Provenance.INCOHERENT]
    assert found.height[0].tolist() == [5.0, 5.0] and found.count[0].tolist() == [1, 1]


def test_a_pair_decides_where_only_the_rivals_of_the_volume_are_too_far_away():
    found = completed(cells_of(5.0, np.nan), volume_of((5.2, 5.2), (Confidence.BLURRED, Confidence.BLURRED)), 1.0)
    assert found.provenance[0].tolist() == [Provenance.ONE_PAIR, Provenance.INCOHERENT]


@pytest.mark.parametrize(("step", "beside"), [(0.0, True), (0.5, True), (4.0, False)])
def test_a_pair_decides_among_near_rivals_on_even_ground_only(step, beside):
    """A slope is even; next to a step nothing is."""
    heights = [*np.arange(6) * 0.5, *(step + np.arange(6, 12) * 0.5)]
    found = completed(cells_of(*heights), volume_of(heights, [Confidence.FAINT] * 12), 1.0)
    measured = found.provenance[0] == Provenance.ONE_PAIR
    assert measured[[0, 1, 10, 11]].all() and (measured[4:8] == beside).all()
    unmatched = completed(cells_of(*[np.nan] * 12), volume_of(heights, [Confidence.FAINT] * 12), 1.0)
    assert (unmatched.provenance == Provenance.INCOHERENT).all()


WHOLE = Window(0, 0, *LEVEL_GRID.shape)
UNEVEN = (0.1, 0.2, 0.3, 0.2, 0.1, 0.2, 0.4, 0.2, 0.1)


def test_the_datum_error_of_one_value_is_that_value():
    assert datum_precision([level_pair(height_sigmas=(0.25,) * 9)], LEVEL_GRID, WHOLE, 10.0) == pytest.approx(0.25)


def test_two_pairs_do_not_average_the_datum_error_out():
    pairs = [level_pair(height_sigmas=(s,) * 9) for s in (0.1, 0.3)]
    assert datum_precision(pairs * 4, LEVEL_GRID, WHOLE, 10.0) == pytest.approx((2 / (0.1**-2 + 0.3**-2)) ** 0.5)


def test_pairs_that_know_next_to_nothing_leave_the_datum_error_of_the_others():
    """Oblique pairs see ground near their horizon: the height is that of the pairs that measured it."""
    pairs = [level_pair(height_sigmas=(s,) * 9) for s in (1.0, 1.0, 40.0)]
    assert datum_precision(pairs, LEVEL_GRID, WHOLE, 10.0).max() < 1.3


def test_a_pair_without_covariance_does_not_hide_what_the_others_know():
    pairs = [level_pair(), level_pair(height_sigmas=(0.3,) * 9)]
    assert datum_precision(pairs, LEVEL_GRID, WHOLE, 10.0) == pytest.approx(0.3)


def test_the_datum_error_is_the_same_in_any_window():
    pairs = [level_pair(height_sigmas=UNEVEN)]
    whole, part = datum_precision(pairs, LEVEL_GRID, WHOLE, 10.0), Window(SPACING - 3, 5, 12, 19)
    assert np.array_equal(datum_precision(pairs, LEVEL_GRID, part, 10.0), whole[part.slices])
    assert 0.1 <= whole.min() < whole.max() <= 0.4


def test_without_covariance_the_orientation_adds_nothing():
    assert (datum_precision([level_pair()], LEVEL_GRID, WHOLE, 10.0) == 0).all()


@pytest.mark.parametrize(
    ("around", "own", "stray"),
    [(95, 45, False), (95, 35, True), (60, 45, True), (60, 55, False)],
    ids=["rim", "blunder", "leaf", "tree"],
)
def test_the_rim_of_a_roof_is_no_stray_height_in_a_town_and_would_be_one_in_a_wood(around: int, own: int, stray: bool):
    shape, middle = (60, 60), (30, 30)
    judgement = np.zeros((*shape, len(Judgement)), np.uint8)
    judgement[..., Judgement.COHERENCE] = around
    judgement[(*middle, Judgement.COHERENCE)] = own
    volume = VolumeWindow(np.full(shape, 8.0, np.float32), judgement, np.full(shape, Confidence.LOW, np.uint8))
    assert volume.stray[middle] == stray
    sure = VolumeWindow(volume.height, judgement, np.full(shape, Confidence.HIGH, np.uint8))
    assert not sure.stray.any()
