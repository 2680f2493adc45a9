"""Standard errors among neighbours of windows that know no walls, on surfaces that can be written down."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.standard_errors import height_range
from orthomill.tasks.densification.precision.wall_blind_errors import wall_blind_precision, window_doubt
from orthomill.tasks.densification.volume.quality import Judgement

SHAPE = (9, 15)
STEP = 2.0
SHARE = 0.45
"""of what matching states, between its nodes"""
NARROW = 0
"""cells of a window that shows one cell only: no doubt about others"""


def wall() -> np.ndarray:
    """Ground at 10 m, a roof at 16 m from column 7 on."""
    height = np.full(SHAPE, 10.0, np.float32)
    height[:, 7:] = 16.0
    return height


def rated(height: np.ndarray, distinctiveness: float = 1.0) -> np.ndarray:
    judgement = np.zeros((*height.shape, len(Judgement)), np.uint8)
    judgement[..., Judgement.DISTINCTIVENESS] = 100 * distinctiveness
    volume = VolumeWindow(height, judgement, np.zeros(height.shape, np.uint8))
    return wall_blind_precision(matched(height), volume, STEP, NARROW)


def matched(height: np.ndarray, sigma: float = 0.1) -> FusedCells:
    codes = np.full(height.shape, Provenance.AGREED, np.uint8)
    return FusedCells(height, np.full(height.shape, sigma, np.float32), np.ones(height.shape, np.uint8), codes)


def test_beside_a_wall_it_grows_the_more_the_lower_the_standing():
    clear, doubtful = rated(wall(), 1.0), rated(wall(), 0.4)
    away = slice(None), slice(0, 2)
    assert (doubtful[:, 5] > 2 * clear[:, 5]).all() and np.array_equal(doubtful[away], clear[away])
    assert (np.diff(clear[4, :7]) >= 0).all() and clear[4, 6] > 5 * clear[4, 0]


def test_windows_that_reach_over_an_edge_bend():
    height = np.full((9, 30), 10.0, np.float32)
    height[:, 20:] = 16.0
    found = rated(height, 2.0)[4]
    assert found[15] > 2 * found[14] and found[14] == pytest.approx(SHARE * 0.1)


def test_a_wide_window_adds_its_doubt():
    wide = wall_blind_precision(matched(np.pad(wall(), 8, mode="edge")), VolumeWindow.unknown((25, 31)), STEP, 3)
    assert wide[12, 12] > 6.0 / np.sqrt(12.0)


def test_ground_that_no_window_joins_with_the_wall_is_not_doubted():
    height = np.full((60, 80), 10.0, np.float32)
    height[:, 40:] = 16.0
    doubt = window_doubt(height, 13)[30]
    # Half a window of 13 cells, and two for a wall that is shown half a window off.
    assert (doubt[:31] == 0.0).all() and (doubt[32:40] > 1.0).all() and (doubt[50:] == 0.0).all()


def uneven_cells(hole: bool, code: Provenance = Provenance.AGREED) -> tuple[FusedCells, VolumeWindow]:
    """Heights with noise of 0.1 m on an inclined plane, and in a corner nothing, if asked."""
    row, col = np.indices((40, 40))
    height = (10 + 0.3 * col + np.random.default_rng(5).normal(0, 0.1, row.shape)).astype(np.float32)
    codes = np.full(height.shape, code, np.uint8)
    if hole:
        height[:4, :4], codes[:4, :4] = np.nan, Provenance.EMPTY
    volume = VolumeWindow.unknown(height.shape)
    volume.judgement[..., Judgement.DISTINCTIVENESS] = 200
    return FusedCells(height, np.full(height.shape, 0.02, np.float32), np.ones(height.shape, np.uint8), codes), volume


def test_uneven_heights_near_what_was_not_measured_are_doubtful():
    calm, holed = (wall_blind_precision(*uneven_cells(hole), STEP, NARROW) for hole in (False, True))
    assert (holed[4:10, 4:10] > 1.2 * calm[4:10, 4:10]).mean() > 0.9
    assert np.array_equal(holed[20:, 20:], calm[20:, 20:]), "eight cells away all is as it was"
    estimates = (wall_blind_precision(*uneven_cells(hole, Provenance.INCOHERENT), STEP, NARROW) for hole in (False, True))
    assert np.array_equal(*(found[20:, 20:] for found in estimates))


def test_no_unevenness_adds_more_than_heights_around_differ():
    cells, volume = uneven_cells(True)
    found = wall_blind_precision(cells, volume, STEP, NARROW)[5:9, 5:9]
    assert (found <= np.hypot(height_range(cells.height, 2)[5:9, 5:9], height_range(cells.height, 5)[5:9, 5:9])).all()


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
