"""Blocks that several tests orient, once."""

import pytest
from orienting import orient
from simulated_block import two_strips


@pytest.fixture(scope="session")
def volos_like():
    """The simulated two-strip block with 2 % wrong measurements, and its tables."""
    block = two_strips(3, wrong=0.02)
    return block, orient(block)
