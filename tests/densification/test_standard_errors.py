"""Standard errors among neighbours on surfaces that can be written down."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.standard_errors import (
    REACH,
    SHARE,
    groundless,
    height_range,
    relative_precision,
    unevenness,
    window_doubt,
    with_distance,
)
from orthomill.tasks.densification.volume.quality import STRETCH_UNIT, Judgement

SHAPE = (9, 15)
STEP = 2.0


def wall() -> np.ndarray:
    """Ground at 10 m, a roof at 16 m from column 7 on."""
    height = np.full(SHAPE, 10.0, np.float32)
    height[:, 7:] = 16.0
    return height


def rated(height: np.ndarray, code: Provenance = Provenance.AGREED, sigma: float = 0.1, standing: float = 1.0) -> np.ndarray:
    precision = np.full(SHAPE, np.nan if code == Provenance.VOLUME else sigma, np.float32)
    judgement = np.zeros((*SHAPE, len(Judgement)), np.uint8)
    judgement[..., Judgement.STANDING] = 100 * standing
    volume = VolumeWindow(height, judgement, np.zeros(SHAPE, np.uint8))
    cells = FusedCells(height, precision, np.ones(SHAPE, np.uint8), np.full(SHAPE, code, np.uint8))
    return relative_precision(cells, volume, STEP)


def test_on_level_ground_the_standard_error_is_that_of_matching():
    assert rated(np.full(SHAPE, 10.0, np.float32), sigma=0.2) == pytest.approx(SHARE * 0.2)


def test_beside_a_wall_it_grows_the_more_the_lower_the_standing():
    clear, doubtful = rated(wall(), standing=1.0), rated(wall(), standing=0.4)
    away = slice(None), slice(0, 2)
    assert (doubtful[:, 5] > 2 * clear[:, 5]).all() and np.array_equal(doubtful[away], clear[away])
    assert (np.diff(clear[4, :7]) >= 0).all() and clear[4, 6] > 5 * clear[4, 0]


def test_windows_that_reach_over_an_edge_bend():
    height = np.full((9, 30), 10.0, np.float32)
    height[:, 20:] = 16.0
    volume = VolumeWindow.unknown(height.shape)
    volume.judgement[..., Judgement.STANDING] = 200
    cells = FusedCells(height, np.full(height.shape, 0.1, np.float32), *(np.ones(height.shape, np.uint8) for _ in range(2)))
    found = relative_precision(cells, volume, STEP)[4]
    assert found[15] > 2 * found[14] and found[14] == pytest.approx(SHARE * 0.1)


def uneven_cells(hole: bool, code: Provenance = Provenance.AGREED) -> tuple[FusedCells, VolumeWindow]:
    """Heights with noise of 0.1 m on an inclined plane, and in a corner nothing, if asked."""
    row, col = np.indices((40, 40))
    height = (10 + 0.3 * col + np.random.default_rng(5).normal(0, 0.1, row.shape)).astype(np.float32)
    codes = np.full(height.shape, code, np.uint8)
    if hole:
        height[:4, :4], codes[:4, :4] = np.nan, Provenance.EMPTY
    volume = VolumeWindow.unknown(height.shape)
    volume.judgement[..., Judgement.STANDING] = 200
    return FusedCells(height, np.full(height.shape, 0.02, np.float32), np.ones(height.shape, np.uint8), codes), volume


def test_uneven_heights_near_what_was_not_measured_are_doubtful():
    calm, holed = (relative_precision(*uneven_cells(hole), STEP) for hole in (False, True))
    assert (holed[4:10, 4:10] > 1.2 * calm[4:10, 4:10]).mean() > 0.9
    assert np.array_equal(holed[20:, 20:], calm[20:, 20:]), "eight cells away all is as it was"
    estimates = (relative_precision(*uneven_cells(hole, Provenance.INCOHERENT), STEP) for hole in (False, True))
    assert np.array_equal(*(found[20:, 20:] for found in estimates))


def test_no_unevenness_adds_more_than_heights_around_differ():
    cells, volume = uneven_cells(True)
    found = relative_precision(cells, volume, STEP)[5:9, 5:9]
    assert (found <= np.hypot(height_range(cells.height, 2)[5:9, 5:9], height_range(cells.height, 5)[5:9, 5:9])).all()


def test_slopes_and_walls_are_even_and_noise_is_not():
    row, col = np.indices((20, 30))
    slope = (0.4 * col - 0.2 * row).astype(np.float32)
    assert unevenness(slope)[3:-3, 3:-3] == pytest.approx(0, abs=1e-5)
    assert unevenness(np.where(col < 15, slope, slope + 8).astype(np.float32))[3:-3, 3:-3] == pytest.approx(0, abs=1e-5)
    noise = np.random.default_rng(2).normal(0, 0.1, (200, 200)).astype(np.float32)
    # The mean of four has half of the noise: a difference of 1.118 sigma, whose absolute value has its median at 0.6745 of it.
    assert np.median(unevenness(noise)) == pytest.approx(0.0754, rel=0.1)


def test_within_a_window_of_a_wall_a_height_may_be_that_of_roof_or_ground():
    """Uniform between 10 and 16 m: a standard error of 6 / sqrt(12)."""
    found = window_doubt(np.pad(wall(), 8, mode="edge"), 3)[12]
    assert found[[12, 14, 15, 17]] == pytest.approx(6.0 / np.sqrt(12.0)) and (found[[2, 11, 18, 24]] == 0).all()


def test_an_even_slope_is_no_doubt_until_much_of_it_is_not_found():
    slope = (0.5 * np.add.outer(np.arange(30), np.arange(30))).astype(np.float32)
    inner = slice(5, -5), slice(5, -5)
    assert (window_doubt(slope, 4)[inner] == 0).all()
    holes = np.where(np.indices(slope.shape).sum(axis=0) % 2, np.float32(np.nan), slope)
    found = window_doubt(holes, 4)[inner]
    # The farthest corners of the window: eight cells in both directions.
    assert found[np.isfinite(holes[inner])] == pytest.approx(0.5 * 16 / np.sqrt(12.0))
    assert (found[np.isnan(holes[inner])] == 0).all()


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
    judgement = np.full((*shape, len(Judgement)), 100, np.uint8)
    judgement[..., Judgement.STRETCH] = STRETCH_UNIT
    volume = VolumeWindow(height + off, judgement, np.zeros(shape, np.uint8))
    cells = FusedCells(height, precision, np.ones(shape, np.uint8), np.full(shape, Provenance.AGREED, np.uint8))
    found = relative_precision(cells, volume, STEP)
    assert found[30, 30] == pytest.approx(max(scatter, 0.45 * STEP), rel=0.01)
    assert found[0, 0] == pytest.approx(SHARE * 0.05), "what pairs measured is not"


def coded(provenance: np.ndarray) -> FusedCells:
    shape = provenance.shape
    return FusedCells(np.zeros(shape, np.float32), np.full(shape, 0.1, np.float32), np.zeros(shape, np.uint8), provenance)


def test_an_estimate_is_the_worse_the_farther_it_is_from_measured_ground():
    codes = np.full((21, 260), Provenance.AGREED, np.uint8)
    codes[:, 10:250] = Provenance.INCOHERENT
    found = with_distance(coded(codes), 0.05).precision[10]
    assert (found[:10] == np.float32(0.1)).all() and found[10] > 0.1
    assert (np.diff(found[10:70]) > 0).all() and found[75:180] == pytest.approx(found[80]) and 6 < found[80] < 8


def test_no_estimate_is_worse_than_things_are_high():
    codes = np.full((21, 260), Provenance.AGREED, np.uint8)
    codes[:, 10:250] = Provenance.INTERPOLATED
    assert with_distance(coded(codes), 5.0).precision.max() == pytest.approx(10.0, rel=1e-3)


def test_single_measured_cells_in_a_crown_make_no_ground():
    codes = np.full((31, 31), Provenance.AGREED, np.uint8)
    codes[8:23, 8:23] = Provenance.INCOHERENT
    around = with_distance(coded(codes), 1.0).precision[15, 14]
    codes[15, 15] = Provenance.AGREED
    assert with_distance(coded(codes), 1.0).precision[15, 14] == around
    assert with_distance(coded(codes), 1.0).precision[15, 15] == np.float32(0.1)


def test_without_any_measured_cell_every_estimate_is_a_far_one():
    codes = np.full((5, 5), Provenance.INTERPOLATED, np.uint8)
    assert (with_distance(coded(codes), 1.0).precision >= 10).all()


def test_cells_without_a_height_have_no_standard_error_and_do_not_disturb_others():
    height = wall()
    height[4, 2] = np.nan
    found = rated(height)
    assert np.isnan(found[4, 2]) and np.isfinite(np.delete(found.ravel(), 4 * SHAPE[1] + 2)).all()


def test_the_range_is_taken_over_the_cells_around():
    expected = [max(wall()[0, max(c - 2, 0) : c + 3]) - min(wall()[0, max(c - 2, 0) : c + 3]) for c in range(SHAPE[1])]
    assert height_range(wall(), 2)[4].tolist() == expected


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
