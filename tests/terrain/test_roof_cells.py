"""Which cells belong to roofs: the opening by discs that the strategy names, and no window that grows with finer cells."""

import numpy as np
import pytest
from scipy import ndimage

from orthomill.tasks.terrain.objects.object_classes import LEAST_ROOF_HEIGHT, RoofRules, roof_cells
from orthomill.tasks.terrain.terrain_tile import TerrainRules


def disc(radius: int) -> np.ndarray:
    row, col = np.ogrid[-radius : radius + 1, -radius : radius + 1]
    return row**2 + col**2 <= radius**2


@pytest.mark.parametrize(("core", "rim"), [(1, 2), (4, 3), (9, 8)])
def test_roofs_are_what_a_disc_opens_and_a_rim_around_it(core, rim):
    rough = np.random.default_rng(core).normal(size=(90, 70))
    measured = ndimage.gaussian_filter(rough, core) > -0.02
    above = np.full(measured.shape, LEAST_ROOF_HEIGHT + 1.0, np.float32)
    inner = np.zeros_like(measured)
    inner[1:-1, 1:-1] = True  # the bend of the cells at the border is not known
    opened = ndimage.binary_opening(measured & inner, disc(core))
    found = roof_cells(above, np.full_like(above, 0.1), measured, 0.2, RoofRules(core, rim))
    assert 0 < np.count_nonzero(opened) < np.count_nonzero(measured & inner)
    np.testing.assert_array_equal(found, ndimage.binary_dilation(opened, disc(rim)))


@pytest.mark.parametrize("cell", [0.001, 0.005, 0.02, 0.5])
def test_the_surroundings_of_a_tile_do_not_grow_with_finer_cells(cell):
    rules = TerrainRules(cell=cell, factor=1, widest=60.0, slope=0.3, steepest=1.0, roughness=0.2, reach=50.0, extent=2000.0 * cell)
    assert rules.roofs.halo < 256
