"""Which blocks are ground: objects taken off, knolls kept, and blocks that ground and objects share."""

import numpy as np
import pytest
from hilly_ground import HOUSE, KNOLL, TREES, bare_land, model

from orthomill.schemas.surface import MEASURED
from orthomill.tasks.terrain.ground.block_heights import block_heights
from orthomill.tasks.terrain.ground.continued_ground import continued
from orthomill.tasks.terrain.ground.islands import standing_islands
from orthomill.tasks.terrain.ground.morphological_filter import disc_radii, filter_halo, ground_cells

RADII = disc_radii(30.0)


def measured() -> np.ndarray:
    z, codes = model()
    return np.where(np.isin(codes, MEASURED), z, np.nan).astype(np.float32)


def test_discs_grow_beyond_half_of_the_widest_object():
    assert disc_radii(30.0) == (1, 2, 4, 8, 16) and disc_radii(1.0) == (1,)
    assert filter_halo((1, 2, 4)) == 14


def test_a_house_is_no_ground_and_what_was_not_measured_neither():
    ground = ground_cells(measured(), RADII, 0.15, 0.2, 1.0)
    assert not ground[HOUSE].any() and not ground[TREES].any()
    assert ground[:80, :80].mean() > 0.99


def test_a_knoll_that_the_filter_takes_off_is_continued_ground_and_the_house_is_not():
    z = measured()
    cut = ground_cells(z, disc_radii(60.0), 0.1, 0.2, 1.0)
    top = tuple(slice(at - 3, at + 4) for at in KNOLL)
    assert not cut[top].any()
    found = continued(cut, z, 0.7, 0.2, 1.0)
    assert found[top].all() and not found[HOUSE].any()
    assert not (found & np.isnan(z)).any()


def test_a_roof_beside_which_nothing_was_measured_is_an_island_and_a_courtyard_is_not():
    z = np.full((80, 80), 10.0, np.float32)
    z[:12, 30:45] = 16.0
    z[:16, 26:30] = z[:16, 45:49] = z[12:16, 26:49] = np.nan
    z[50:62, 20:32] = np.nan
    z[54:58, 24:28] = 10.4
    stands = standing_islands(np.isfinite(z), z, 30, (1.2, 0.15, 0.2), 2)
    assert stands[:12, 30:45].all() and not stands[54:58, 24:28].any() and stands.sum() == 12 * 15


def test_a_glimpse_into_a_wide_gap_may_rise_half_as_much_as_land():
    """One crown that was measured in a wood became a hill of four metres."""
    z = np.full((80, 80), 10.0, np.float32)
    z[15:65, 15:65] = np.nan
    glimpse = z.copy()
    glimpse[39:41, 39:41] = 12.5
    rises = (1.2, 0.15, 0.2)
    assert standing_islands(np.isfinite(glimpse), glimpse, 60, rises, 2)[39:41, 39:41].all()
    assert not standing_islands(np.isfinite(z), np.minimum(glimpse, 11.5), 60, rises, 2).any()


def test_a_lone_block_is_held_against_the_patches_around_it():
    """Far from the land a crown of three metres may be a hill; amid glimpses of the ground below it is none."""
    row, col = np.mgrid[:150, :150]
    ring = np.abs(np.hypot(row - 51, col - 71) - 10.5) < 1.5
    z = np.where((col < 20) | (ring & (row % 5 > 0) & (col % 5 > 0)), np.float32(10.0), np.float32(np.nan))
    lone = z.copy()
    lone[51, 71] = 13.0
    rises = (1.2, 0.15, 0.2)
    stands = standing_islands(np.isfinite(lone), lone, 60, rises, 2)
    assert stands[51, 71] and stands.sum() == 1
    assert not standing_islands(np.isfinite(lone), np.fmin(lone, np.float32(11.0)), 60, rises, 2).any()


def test_a_crown_far_from_the_land_is_held_against_the_wider_glimpses_around():
    """Three blocks of a crown, far from land on one side, were a mound of four metres in a closed wood."""
    z = np.full((200, 240), np.nan, np.float32)
    z[:, :80] = 10.0
    for row, col in ((86, 150), (86, 170), (100, 178), (115, 165), (112, 145), (98, 140)):
        z[row : row + 7, col : col + 7] = 11.5
    z[103:106, 161:164] = 15.5
    rises = 0.9, 0.12, 0.1
    stands = standing_islands(np.isfinite(z), z, 75, rises, 5)
    assert stands[103:106, 161:164].all() and stands.sum() == 9
    assert not standing_islands(np.isfinite(z), z, 75, rises, 2).any()


def test_a_block_that_ground_and_a_roof_share_has_the_height_of_the_ground():
    heights = np.full((8, 8), 10.0, np.float32)
    heights[:, 4:] = 16.0
    ones = np.ones((8, 8), np.float32)
    blocks = block_heights(heights, 0.1 * ones, 0.02 * ones, ones > 0, 8, 0.5)
    assert blocks[0, 0] == pytest.approx([10.0, 0.1, 0.02], abs=1e-6)


def test_a_block_needs_an_eighth_of_its_cells_and_the_last_one_may_be_smaller():
    heights, ones = np.full((6, 6), 10.0, np.float32), np.ones((6, 6), np.float32)
    few = np.zeros((6, 6), bool)
    few[0, 0] = few[4, 4] = True
    blocks = block_heights(heights, ones, ones, few, 4, 0.5)
    assert np.isnan(blocks[..., 0]).all() and np.isinf(blocks[..., 1]).all()
    few[4, 5] = True
    assert np.isfinite(block_heights(heights, ones, ones, few, 4, 0.5)[1, 1]).all()


def test_blocks_of_one_cell_are_the_cells():
    z = bare_land().astype(np.float32)
    known = np.arange(z.size).reshape(z.shape) % 3 > 0
    blocks = block_heights(z, 0.1 * z, 0.2 * z, known, 1, 0.5)
    assert np.array_equal(blocks[known][:, 0], z[known]) and np.isnan(blocks[~known][:, 0]).all()
