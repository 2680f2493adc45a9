"""Numbers that no arithmetic can hold are answered with a sentence about the block."""

import numpy as np
import pytest
from small_network import small_network

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.solve.whole_block import WholeMotion, _best_motion


def test_contradictions_that_overflow_are_a_sentence():
    with pytest.raises(GeometryError, match="look for a position or control point with a wrong coordinate"):
        _best_motion(lambda motion: np.array([np.nan, 1.0, 2.0]) + motion[0])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("growth", [-1e4, 1e4])
def test_a_change_of_scale_beyond_all_numbers_is_the_largest_one(growth):
    _, state, _ = small_network()
    motion = WholeMotion(np.array([0.0, 0, 0, 0, 0, 0, growth]), state.centre.mean(axis=0), 40.0)
    moved = motion.of(state, np.arange(len(state.point)))
    assert np.isfinite(moved.point).all() and np.isfinite(moved.centre).all()
