"""The up direction of photographs and of the model: attitudes first, then what the block shows."""

import numpy as np
import pytest
from simulated_block import looking

from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.start.up_direction import DOWN, TOP, expected_up, up_direction

UNKNOWN, EAST = np.full((4, 3), np.nan), np.array([1.0, 0.0, 0.0])
TOPS = np.tile(TOP, (4, 1))


def down(tilt=0.05):
    return np.array([rotation_matrix(tilt * (-1) ** i, 0.0, 0.3 * i) for i in range(4)])


def level(*forwards):
    return np.array([looking(forward) for forward in forwards])


AHEAD = level(*[(1, 0.1 * i, 0) for i in range(4)])
AROUND = level((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0))
ASIDE = level(*[(0.05 * i, 1, 0) for i in range(4)])


@pytest.mark.parametrize(
    ("rotation", "basis"),
    [(down(), "down"), (AHEAD, "level"), (AROUND, "level"), (ASIDE, "down")],
    ids=["down", "ahead", "around", "aside"],
)
def test_the_block_tells_what_it_can(rotation, basis):
    """Photographs that look aside from their line might as well look down: only the workflow can say."""
    up, found = expected_up(rotation, UNKNOWN, TOPS, "auto", EAST)
    assert found == basis
    np.testing.assert_array_equal(up, np.tile(DOWN if basis == "down" else TOP, (4, 1)))


@pytest.mark.parametrize("looking_", ["down", "level"])
def test_the_workflow_overrides_the_block(looking_):
    assert expected_up(AHEAD, UNKNOWN, TOPS, looking_, EAST)[1] == looking_


def test_one_attitude_is_enough():
    known = UNKNOWN.copy()
    known[2] = [0, 0.6, 0.8]
    up, basis = expected_up(AHEAD, known, TOPS, "level", EAST)
    assert basis == "attitude" and up is known


@pytest.mark.parametrize(("rotation", "up"), [(AHEAD, TOPS), (AROUND, TOPS)])
def test_level_photographs_agree_on_the_vertical(rotation, up):
    np.testing.assert_allclose(up_direction(rotation, up), [0, 0, 1], atol=1e-12)


def test_opposite_tilts_cancel():
    np.testing.assert_allclose(up_direction(down(0.2)[:2] @ np.eye(3), np.tile(DOWN, (2, 1))), [0, 0, 1], atol=1e-12)


def test_unknown_directions_do_not_count():
    up = np.vstack([DOWN, [[np.nan] * 3] * 3])
    rotation = np.array([np.eye(3), *level((1, 0, 0), (0, 1, 0), (-1, 0, 0))])
    np.testing.assert_allclose(up_direction(rotation, up), [0, 0, 1])
