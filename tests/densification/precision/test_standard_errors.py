"""Standard errors among neighbours on surfaces that can be written down."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.matched_ground import matched_ground
from orthomill.tasks.densification.precision.pair_differences import CLASSES, NO_DIFFERENCES, MatchingDifferences, factors
from orthomill.tasks.densification.precision.standard_errors import height_range, matched_error, relative_precision
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.volume.quality import LEVEL_UNIT, STRETCH_UNIT, Judgement
from orthomill.tasks.matching.dense.unevenness import unevenness

SHAPE = (9, 15)
STEP = 2.0
CLEAR = 2.5
"""a distinctiveness that leaves no doubt"""
COMMON = 0.4
"""what all pairs have in common, share of the standard error of one"""
SHARE = float(factors(NO_DIFFERENCES)[0, 0] * np.hypot(1, COMMON))
"""of what matching states of a single pair, on level ground of a block of which nothing is known"""


def wall() -> np.ndarray:
    """Ground at 10 m, a roof at 16 m from column 7 on."""
    height = np.full(SHAPE, 10.0, np.float32)
    height[:, 7:] = 16.0
    return height


def rated(
    height: np.ndarray, code: Provenance = Provenance.AGREED, sigma: float = 0.1, distinctiveness: float = CLEAR
) -> np.ndarray:
    return precision_of(coded(height, code, sigma), volume_at(height, distinctiveness))


def precision_of(cells: FusedCells, volume: VolumeWindow, differences: MatchingDifferences = NO_DIFFERENCES) -> np.ndarray:
    ground = matched_ground(cells, STEP, 1.0)
    return relative_precision(cells, volume, ground, matched_error(cells, volume, ground, differences))


def coded(height: np.ndarray, code: Provenance = Provenance.AGREED, sigma: float = 0.1) -> FusedCells:
    precision = np.full(height.shape, np.nan if code == Provenance.VOLUME else sigma, np.float32)
    return FusedCells(height, precision, np.ones(height.shape, np.uint8), np.full(height.shape, code, np.uint8))


def volume_at(height: np.ndarray, distinctiveness: float = CLEAR) -> VolumeWindow:
    judgement = np.zeros((*height.shape, len(Judgement)), np.uint8)
    judgement[..., Judgement.DISTINCTIVENESS] = 100 * distinctiveness
    return VolumeWindow(height, judgement, np.zeros(height.shape, np.uint8))


def test_on_level_ground_the_standard_error_is_that_of_matching():
    assert rated(np.full(SHAPE, 10.0, np.float32), sigma=0.2) == pytest.approx(SHARE * 0.2, rel=1e-3)


def test_slopes_are_rated_as_level_ground_is():
    slope = (0.5 * np.indices((20, 30))[1]).astype(np.float32)
    assert rated(slope)[3:-3, 3:-3] == pytest.approx(SHARE * 0.1, rel=1e-3)


def test_beside_a_wall_all_pairs_err_alike_and_below_it_the_most():
    shape = (20, 40)
    height = np.full(shape, 10.0, np.float32)
    height[:, 20:] = 30.0
    away, below, above = rated(height)[10, [5, 19, 20]]
    beside = factors(NO_DIFFERENCES)[1, 0]
    assert away == pytest.approx(SHARE * 0.1, rel=1e-3)
    assert below == pytest.approx(0.1 * beside * np.sqrt(1 + COMMON**2 + 1.0), rel=0.02)
    assert above == pytest.approx(0.1 * beside * np.sqrt(1 + COMMON**2 + 0.25), rel=0.02)


@pytest.mark.parametrize(("level", "error"), [(0.0, 1.15), (2.0, 4.6)])
def test_a_height_of_a_coarser_level_is_worth_its_steps(level, error):
    volume = volume_at(np.random.default_rng(0).normal(10, 3, SHAPE).astype(np.float32))
    volume.confidence[:] = Confidence.COARSE
    volume.judgement[..., Judgement.LEVEL] = level * LEVEL_UNIT
    found = precision_of(coded(volume.height, Provenance.COARSE), volume)
    assert found == pytest.approx(np.hypot(error * STEP, 1.5), rel=1e-3), "leaves begin higher than photographs agree"


def test_where_a_pair_decided_between_near_rivals_the_heights_around_count():
    clear, strained = (rated(wall(), distinctiveness=distinctiveness)[4] for distinctiveness in (0.75, 0.65))
    assert strained[6] == pytest.approx(np.hypot(clear[6], 0.3 * 6), rel=0.02) and strained[2] < 1.5 * clear[2]


def test_a_height_of_the_volume_without_standing_may_be_that_of_a_rival_some_steps_away():
    level = np.full(SHAPE, 10.0, np.float32)
    none, low, usual = (
        rated(level, Provenance.VOLUME, distinctiveness=distinctiveness)[0, 0] for distinctiveness in (0.0, 0.5, 1.0)
    )
    assert none == pytest.approx(np.hypot(0.7, 0.35) * STEP, rel=1e-3) and none > 1.5 * low and low > usual > 0.35 * STEP


def test_among_rivals_all_pairs_err_alike():
    level = np.full(SHAPE, 10.0, np.float32)
    none, usual = (rated(level, distinctiveness=distinctiveness)[4, 7] for distinctiveness in (0.0, 1.0))
    assert none / usual == pytest.approx(np.sqrt((1 + COMMON**2 + 1.5**2) / (1 + COMMON**2)), rel=1e-3)


def test_a_block_whose_pairs_differ_less_has_smaller_standard_errors():
    level = np.full(SHAPE, 10.0, np.float32)
    counts = np.zeros((2 * CLASSES, 100), int)
    counts[0, 5] = 10**7
    cells = coded(level)
    found = precision_of(cells, volume_at(level), MatchingDifferences(counts=tuple(map(tuple, counts.tolist()))))
    # 68.3 % of a class from 0.2 to 0.24.
    assert found == pytest.approx(0.1 * np.hypot(1, COMMON) * (0.2 + 0.04 * 0.683), rel=1e-3)


def test_the_least_standing_of_the_neighbours_counts():
    volume = volume_at(np.full(SHAPE, 10.0, np.float32))
    volume.judgement[4, 7, Judgement.DISTINCTIVENESS] = 0
    found = precision_of(coded(np.full(SHAPE, 10.0, np.float32)), volume)
    assert (found[3:6, 6:9] > 1.5 * found[0, 0]).all() and found[4, 5] == found[0, 0] < 0.1


def noisy(sigma: float) -> np.ndarray:
    """Heights (40, 40) m with noise on an inclined plane."""
    return (10 + 0.3 * np.indices((40, 40))[1] + np.random.default_rng(5).normal(0, sigma, (40, 40))).astype(np.float32)


def test_heights_that_differ_from_their_neighbours_are_doubtful():
    calm, uneven = (np.median(rated(noisy(sigma), sigma=0.02)) for sigma in (1e-4, 1e-2))
    assert calm == pytest.approx(SHARE * 0.02, rel=0.1) and uneven > 2 * calm


def test_a_height_of_the_volume_is_worth_less_where_heights_around_differ():
    even, uneven = (rated(noisy(sigma), Provenance.VOLUME)[5:-5, 5:-5] for sigma in (0.0, 1.0))
    # An even slope of 0.3 over four cells.
    assert even == pytest.approx(np.hypot(0.35 * STEP, 0.15 * 4 * 0.3), rel=1e-3) and np.median(uneven) > 1.1 * np.median(even)


def test_no_unevenness_adds_more_than_heights_around_differ():
    height = noisy(0.1)
    assert (rated(height) <= np.hypot(height_range(height, 2), SHARE * 0.1) + 1e-3).all()


def strange(off: np.ndarray, unknown: int, code: Provenance = Provenance.AGREED) -> float:
    """Standard error of a cell of level ground with the volume `off` (m) beside the pairs, where `unknown` columns to its left were
    not measured."""
    level = np.full(off.shape, 10.0, np.float32)
    cells = coded(level, code)
    cells.provenance[:, 15 - unknown : 15] = Provenance.INCOHERENT
    return float(precision_of(cells, volume_at(level + off.astype(np.float32)))[15, 15])


def test_where_pairs_and_volume_scatter_beside_what_was_not_measured_heights_are_doubtful():
    off = np.where(np.indices((31, 31)).sum(0) % 2, 1.0, -1.0)
    alone, little, much = (strange(off, unknown) for unknown in (0, 1, 4))
    assert alone == pytest.approx(SHARE * 0.1, rel=1e-3) and alone < little < much
    # Four of nine columns; the volume lies one metre away on either side.
    assert much == pytest.approx(np.hypot(0.9 * 4 / 9, SHARE * 0.1), rel=0.02)
    assert strange(np.full((31, 31), 1.0), 4) == pytest.approx(alone), "what all have in common is no scatter"


def test_slopes_and_walls_are_even_and_noise_is_not():
    row, col = np.indices((20, 30))
    slope = (0.4 * col - 0.2 * row).astype(np.float32)
    assert unevenness(slope)[3:-3, 3:-3] == pytest.approx(0, abs=1e-5)
    assert unevenness(np.where(col < 15, slope, slope + 8).astype(np.float32))[3:-3, 3:-3] == pytest.approx(0, abs=1e-5)
    noise = np.random.default_rng(2).normal(0, 0.1, (200, 200)).astype(np.float32)
    # The mean of four has half of the noise: a difference of 1.118 sigma, whose absolute value has its median at 0.6745 of it.
    assert np.median(unevenness(noise)) == pytest.approx(0.0754, rel=0.1)


def test_a_height_of_the_volume_is_known_to_a_share_of_its_step():
    level = rated(np.full(SHAPE, 10.0, np.float32), Provenance.VOLUME)
    assert (level > 0).all() and (level < STEP / 2).all()


@pytest.mark.parametrize("scatter", [0.1, 3.0])
def test_a_height_of_the_volume_is_as_doubtful_as_the_volume_beside_the_pairs_around(scatter):
    shape = 60, 60
    height = np.full(shape, 10.0, np.float32)
    precision = np.full(shape, 0.05, np.float32)
    height[30, 30], precision[30, 30] = 10.0, np.nan
    off = scatter * np.where(np.indices(shape).sum(0) % 2, 1, -1).astype(np.float32)
    judgement = np.full((*shape, len(Judgement)), 250, np.uint8)
    judgement[..., Judgement.STRETCH] = STRETCH_UNIT
    volume = VolumeWindow(height + off, judgement, np.zeros(shape, np.uint8))
    cells = FusedCells(height, precision, np.ones(shape, np.uint8), np.full(shape, Provenance.AGREED, np.uint8))
    found = precision_of(cells, volume)
    assert found[30, 30] == pytest.approx(max(np.sqrt(np.pi / 2) * scatter, 0.35 * STEP), rel=0.01)
    assert found[0, 0] == pytest.approx(SHARE * 0.05, rel=1e-3), "what pairs measured is not"


def test_cells_without_a_height_have_no_standard_error_and_do_not_disturb_others():
    height = wall()
    height[4, 2] = np.nan
    found = rated(height)
    assert np.isnan(found[4, 2]) and np.isfinite(np.delete(found.ravel(), 4 * SHAPE[1] + 2)).all()


def test_the_range_is_taken_over_the_cells_around():
    expected = [max(wall()[0, max(c - 2, 0) : c + 3]) - min(wall()[0, max(c - 2, 0) : c + 3]) for c in range(SHAPE[1])]
    assert height_range(wall(), 2)[4].tolist() == expected
