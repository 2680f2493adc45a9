"""Numbers that no arithmetic can hold are answered with a sentence about the block."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import small_network

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.solve.whole_block import WholeMotion, fitted_whole


def test_contradictions_that_overflow_are_a_sentence():
    network, state, _ = small_network()
    with pytest.raises(GeometryError, match="look for a position or control point with a wrong coordinate"):
        fitted_whole(replace(network, centre=np.full_like(network.centre, np.nan)), state)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("growth", [-1e4, 1e4])
def test_a_change_of_scale_beyond_all_numbers_is_the_largest_one(growth):
    _, state, _ = small_network()
    motion = WholeMotion(np.array([0.0, 0, 0, 0, 0, 0, growth]), state.centre.mean(axis=0), 40.0)
    moved = motion.of(state, np.arange(len(state.point)))
    assert np.isfinite(moved.point).all() and np.isfinite(moved.centre).all()
