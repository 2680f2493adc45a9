"""Real named points of a wall: resection and intersection agree with MicMac's orientation."""

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.orientation.stone_wall import compared, read_wall, resected

WALL = Path(os.environ.get("ORTHOMILL_DATA", Path(__file__).parents[3] / "shared" / "data")) / "stone_wall"
pytestmark = pytest.mark.skipif(not WALL.exists(), reason="the stone wall's photographs are not at ../shared/data/stone_wall")


def test_resection_and_intersection_agree_with_micmac_within_their_standard_errors():
    for standardised in compared(read_wall(WALL)).standardised:
        assert np.abs(standardised).max() < 2.0


def test_the_start_does_not_matter():
    wall = read_wall(WALL)
    one, two = (resected(wall, seed).state.centre for seed in (1, 2))
    assert np.abs(one - two).max() < 1e-4
