"""The sum of the lowest values of columns, beside sorting them."""

import numpy as np
import pytest

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.volume.lowest_sums import exchanges, lowest_sums


@njit()
def _sums(values, rows, take, pairs, n, sums):
    lowest_sums(values, rows, take, pairs, n, sums)


@pytest.mark.parametrize("rows", [1, 2, 3, 6, 10, 15, 21, 28, 45])
def test_the_lowest_values_are_summed_as_by_sorting(rows: int) -> None:
    rng = np.random.default_rng(rows)
    # Rows and columns beyond those that count must not matter.
    values = rng.integers(0, 49, (rows + 2, 70)).astype(np.uint8)
    for take in range(rows + 1):
        sums = np.full(80, 7, np.uint16)
        _sums(values.copy(), rows, take, exchanges(rows), 64, sums)
        assert (sums[:64] == np.sort(values[:rows, :64], axis=0)[:take].sum(axis=0)).all()
        assert (sums[64:] == 7).all()


def test_half_of_the_pairs_of_eight_photographs_take_few_exchanges() -> None:
    # To move the 14 lowest of 28 to the front one after the other takes 287.
    assert len(exchanges(28)) <= 110
