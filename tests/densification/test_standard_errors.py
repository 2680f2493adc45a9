"""Standard errors among neighbours on surfaces that can be written down."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.standard_errors import REACH, SHARE, height_range, relative_precision

SHAPE = (9, 15)
STEP = 2.0


def wall() -> np.ndarray:
    """Ground at 10 m, a roof at 16 m from column 7 on."""
    height = np.full(SHAPE, 10.0, np.float32)
    height[:, 7:] = 16.0
    return height


def rated(height: np.ndarray, code: Provenance = Provenance.AGREED, sigma: float = 0.1, margin: float = 1.0) -> np.ndarray:
    precision = np.full(SHAPE, np.nan if code == Provenance.VOLUME else sigma, np.float32)
    quality = np.zeros((*SHAPE, 4), np.uint8)
    quality[..., 1] = 100 * margin
    volume = VolumeWindow(height, quality, np.zeros(SHAPE, np.uint8))
    cells = FusedCells(height, precision, np.ones(SHAPE, np.uint8), np.full(SHAPE, code, np.uint8))
    return relative_precision(cells, volume, STEP)


def test_on_level_ground_the_standard_error_is_that_of_matching():
    assert rated(np.full(SHAPE, 10.0, np.float32), sigma=0.2) == pytest.approx(SHARE * 0.2)


def test_beside_a_wall_it_grows_the_more_the_smaller_the_margin():
    clear, doubtful = rated(wall(), margin=1.0), rated(wall(), margin=0.3)
    away = slice(None), slice(0, 7 - REACH)
    assert clear[:, 6].min() > 5 * clear[away].max()
    assert (doubtful[:, 6] > 2 * clear[:, 6]).all() and np.array_equal(doubtful[away], clear[away])


def test_a_height_of_the_volume_is_known_to_a_share_of_its_step():
    level = rated(np.full(SHAPE, 10.0, np.float32), Provenance.VOLUME)
    assert (level > 0).all() and (level < STEP / 3).all()


def test_an_estimate_is_never_better_than_the_step_of_the_volume():
    assert (rated(wall(), Provenance.INCOHERENT) >= STEP).all()


def test_cells_without_a_height_have_no_standard_error_and_do_not_disturb_others():
    height = wall()
    height[4, 2] = np.nan
    found = rated(height)
    assert np.isnan(found[4, 2]) and np.isfinite(np.delete(found.ravel(), 4 * SHAPE[1] + 2)).all()


def test_the_range_is_taken_over_the_cells_around():
    expected = [max(wall()[0, max(c - 2, 0) : c + 3]) - min(wall()[0, max(c - 2, 0) : c + 3]) for c in range(SHAPE[1])]
    assert height_range(wall(), 2)[4].tolist() == expected
