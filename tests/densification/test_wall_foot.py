"""Heights at the foot of a wall that can be written down."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.matched_ground import matched_ground
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.volume.quality import Judgement
from orthomill.tasks.densification.wall_foot import volume_share, with_volume

SHAPE, STEP, WALL = (25, 40), 0.5, 20
"""cells; m between the heights of the volume; the first column of the roof"""
SIGMA = 0.25
"""m, of the pairs: what half a step is, so that both weigh the same at the foot of a high wall"""


def town(rise: float = 6.0) -> np.ndarray:
    """Ground at 10 m, a roof that is so much higher from column WALL on."""
    height = np.full(SHAPE, 10.0, np.float32)
    height[:, WALL:] += rise
    return height


def matched(height: np.ndarray) -> FusedCells:
    counts = np.full(SHAPE, 2, np.uint8)
    return FusedCells(height, np.full(SHAPE, SIGMA, np.float32), counts, np.full(SHAPE, Provenance.AGREED, np.uint8))


def volume(height: np.ndarray, confidence: Confidence = Confidence.HIGH, coherence: int = 100) -> VolumeWindow:
    judgement = np.zeros((*SHAPE, len(Judgement)), np.uint8)
    judgement[..., Judgement.COHERENCE] = coherence
    return VolumeWindow(height, judgement, np.full(SHAPE, confidence, np.uint8))


def share(height: np.ndarray, of: VolumeWindow, sigma: float = SIGMA) -> np.ndarray:
    cells = matched(height)
    return volume_share(cells, of, matched_ground(cells, STEP, 1.0), np.full(SHAPE, sigma))


def test_at_the_foot_of_a_high_wall_both_weigh_by_their_variances():
    at_foot = share(town(60.0), volume(town(60.0)))[12, WALL - 2]
    assert at_foot == pytest.approx(0.5, abs=1e-3)
    precise = share(town(60.0), volume(town(60.0)), 0.1 * SIGMA)[12, WALL - 2]
    assert precise == pytest.approx(1 / 101, rel=1e-2)


def test_pairs_alone_tell_on_top_of_the_wall_and_away_from_it():
    shares = share(town(), volume(town()))
    assert (shares[:, WALL:] == 0).all()
    assert (shares[:, : WALL - 6] == 0).all()
    assert (shares[:, WALL - 4 : WALL] > 0).all()


def test_a_slope_has_no_foot():
    slope = (10 + 0.4 * np.indices(SHAPE)[1]).astype(np.float32)
    assert (share(slope, volume(slope))[6:-6, 6:-6] < 1e-3).all()


def test_the_lower_the_wall_the_less_the_volume_says():
    shares = [share(town(rise), volume(town(rise)))[12, WALL - 2] for rise in (0.1, 0.5, 2.0, 6.0)]
    assert shares == sorted(shares) and shares[0] < 0.1 < shares[-1]


def test_a_volume_that_its_surroundings_contradict_says_nothing():
    shares = [share(town(), volume(town(), coherence=coherence))[12, WALL - 2] for coherence in (40, 60, 80, 100)]
    assert shares == sorted(shares) and shares[0] == 0


def test_a_volume_that_is_off_the_pairs_around_says_less():
    """As below trees."""
    rough = town() + np.where(np.indices(SHAPE).sum(axis=0) % 2, 1, -1).astype(np.float32)
    assert share(town(), volume(rough))[12, WALL - 2] < 0.3 * share(town(), volume(town()))[12, WALL - 2]


@pytest.mark.parametrize("missing", ["pairs", "volume", "alone"])
def test_where_one_of_both_has_no_height_nothing_is_moved(missing: str):
    height = town()
    cells, of = matched(height), volume(town(), Confidence.COARSE if missing == "alone" else Confidence.HIGH)
    if missing == "pairs":
        cells = FusedCells(height, np.full(SHAPE, np.nan, np.float32), cells.count, cells.provenance)
    if missing == "volume":
        of = VolumeWindow(np.full(SHAPE, np.nan, np.float32), of.judgement, of.confidence)
    shares = volume_share(cells, of, matched_ground(cells, STEP, 1.0), np.full(SHAPE, SIGMA))
    assert (shares == 0).all()
    assert (with_volume(height, of, shares) == height).all()


def test_heights_move_towards_the_volume_by_its_share():
    pairs, ground = town() + np.float32(0.4), volume(town())
    moved = with_volume(pairs, ground, np.full(SHAPE, 0.25))
    np.testing.assert_allclose(moved, pairs - 0.1, atol=1e-5)
