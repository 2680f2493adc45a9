"""A packed list is a list; what cannot be packed stays in it as it is."""

import pickle

import numpy as np

from orthomill.pipeline.records.packed_list import BLOCK, PackedList


def packed(count: int) -> PackedList:
    found = PackedList(pickle.dumps, pickle.loads)
    for number in range(count):
        found.append(("element", number))
    return found


def test_elements_come_back_in_any_order():
    count = 7 * BLOCK + 5
    found = packed(count)
    assert len(found) == count and list(found) == [("element", number) for number in range(count)]
    for number in np.random.default_rng(1).permutation(count).tolist():
        assert found[number] == ("element", number)
    assert sum(map(len, found._blocks)) < 8 * count and len(found._unpacked) <= 7


def test_what_cannot_be_packed_stays_as_it_is():
    found, odd = PackedList(pickle.dumps, pickle.loads), lambda: 3
    for number in range(2 * BLOCK):
        found.append(odd if number == 7 else number)
    assert found[7] is odd and found[8] == 8 and found[2 * BLOCK - 1] == 2 * BLOCK - 1
