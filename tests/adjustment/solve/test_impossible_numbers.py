"""Numbers that no arithmetic can hold are answered with a sentence about the block."""

import numpy as np
import pytest

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.solve.whole_block import _best_motion


def test_contradictions_that_overflow_are_a_sentence():
    with pytest.raises(GeometryError, match="look for a position or control point with a wrong coordinate"):
        _best_motion(lambda motion: np.array([np.nan, 1.0, 2.0]) + motion[0])
