"""Which of the places that photographs find of one point is taken."""

import numpy as np
import pytest

from orthomill.schemas.accuracy.point_tests import TESTED, UNEVEN, HeightTest, PlaceTest
from orthomill.tasks.accuracy.points.agreeing_places import agreed_place
from orthomill.tasks.accuracy.points.surface_height import on_even_ground

VARIANCE = 0.1**2


def agreed(*places, witnesses):
    found = np.array(places, float)
    return agreed_place(found, np.full(found.shape, VARIANCE), witnesses)


def test_one_photograph_that_finds_the_point_elsewhere_is_left_out():
    found = agreed((10, 20), (10.1, 20), (12, 20), (9.9, 20), witnesses=4)
    assert found.tested and found.photos == 3 and found.place == pytest.approx((10, 20))
    assert found.sigma[1] == pytest.approx(0.1 / np.sqrt(3))


@pytest.mark.parametrize(
    ("places", "witnesses"),
    [(((10, 20), (10, 21.6)), 2), (((10, 20), (10.1, 20)), 4), (((10, 20),), 2), (((10, 20), (13, 20), (16, 20)), 3)],
)
def test_no_more_than_half_of_the_photographs_prove_no_place(places, witnesses):
    found = agreed(*places, witnesses=witnesses)
    assert not found.tested and found.place is None and f"of {witnesses} photographs" in found.reason


def test_places_that_scatter_more_than_they_state_say_so():
    found = agreed((10, 20), (10.3, 20), (9.7, 20), witnesses=3)
    assert found.sigma[0] == pytest.approx(0.3 / np.sqrt(3)) and found.sigma[1] == pytest.approx(0.1 / np.sqrt(3))


def test_a_place_beside_an_edge_is_listed_and_not_counted():
    place = PlaceTest(reason=TESTED, place=(10.0, 20.0), sigma=(0.1, 0.1))
    beside = on_even_ground(place, HeightTest(reason="beside an edge", uneven=True))
    assert beside.reason == UNEVEN and beside.place == place.place
    assert on_even_ground(place, HeightTest(reason="on a slope of 30 %")) is place
    assert on_even_ground(place, None) is place
