"""Rows of a table by photograph."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from orthomill.tasks.imagery.photograph_rows import rows_of_photos


@given(st.lists(st.integers(0, 4), max_size=30))
def test_every_photograph_gets_its_rows_in_their_order(numbers):
    photo = np.array(numbers, np.int32)
    found = rows_of_photos(photo, 6)
    assert [own.tolist() for own in found] == [np.flatnonzero(photo == number).tolist() for number in range(6)]
