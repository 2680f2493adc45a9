"""Sizes of what stands on the ground, and of what a block of an object shows."""

import numpy as np
import pytest

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.estimate_errors import with_surroundings
from orthomill.tasks.densification.precision.natural_sizes import LEAVES, TALLEST, natural


@pytest.mark.parametrize("cell", [0.01, 0.05, 1.0, 30.0])
def test_a_tree_is_as_high_whatever_the_cells_of_a_flight_are(cell: float):
    assert natural(TALLEST, cell) == TALLEST


def test_on_an_object_the_same_is_as_many_cells_high_as_in_the_finest_flight():
    assert natural(LEAVES, 0.001) == pytest.approx(LEAVES / 10)
    assert natural(TALLEST, 0.0002) == pytest.approx(0.2)


@pytest.mark.parametrize(("cell", "sigma"), [(0.5, TALLEST), (0.001, 1.0)])
def test_a_guess_far_from_all_that_was_measured_is_as_uncertain_as_things_are_high(cell: float, sigma: float):
    shape = (9, 9)
    nothing = FusedCells(
        np.full(shape, 5.0, np.float32),
        np.full(shape, 0.001, np.float32),
        np.zeros(shape, np.uint8),
        np.full(shape, Provenance.INTERPOLATED, np.uint8),
    )
    assert with_surroundings(nothing, np.zeros(shape, bool), cell).precision == pytest.approx(sigma, rel=1e-4)
