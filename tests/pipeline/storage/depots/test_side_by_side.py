"""Requests that are on their way together: as many as the depot takes, in order, and no more than can be taken."""

from threading import Barrier

import pytest

from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.side_by_side import side_by_side


@pytest.fixture
def depot(tmp_path):
    found = Folder(tmp_path)
    found.at_once = 4
    return found


def test_as_many_requests_as_the_depot_answers_are_on_their_way_and_their_order_is_kept(depot):
    together = Barrier(4)

    def read(number: int) -> int:
        together.wait(10)  # breaks unless four are here at a time
        return number * number

    assert list(side_by_side(depot, read, range(16))) == [number * number for number in range(16)]


def test_nothing_is_asked_for_before_there_is_room_for_it(depot):
    asked: list[int] = []
    found = side_by_side(depot, asked.append, range(100))
    next(found)
    assert len(asked) <= 5
    found.close()
    assert len(asked) <= 5


def test_a_disk_is_read_one_after_the_other(tmp_path):
    asked: list[int] = []
    next(side_by_side(Folder(tmp_path), asked.append, range(9)))
    assert asked == [0]


def test_the_error_of_an_item_comes_where_its_value_would(depot):
    found = side_by_side(depot, lambda number: 1 // number, [1, 1, 0, 1])
    assert [next(found), next(found)] == [1, 1]
    with pytest.raises(ZeroDivisionError):
        next(found)
