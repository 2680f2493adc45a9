"""Which photographs a place gets: the steepest first, several directions, and whatever an oblique block has."""

import numpy as np
import pytest
from box_scene import CAMERA

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.volume.photograph_choice import PLACE, base_height, places, preferred, sight
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

GRID = MapGrid(west=-50.0, north=50.0, cell=1.0, rows=100, cols=100)
ORIGIN = np.zeros((1, 3))


def view(x: float, y: float, z: float = 200.0, tilt: float = 0.0, name: str = "") -> View:
    return View(name or f"{x}/{y}", CAMERA, rotation_matrix(tilt, 0.0, 0.0), np.array([x, y, z]))


def order(views: list[View], most: int, surroundings: float = 0.0) -> list[int]:
    numbers = preferred(sight(views, ORIGIN, surroundings), most)[0]
    return numbers[numbers >= 0].tolist()


def test_places_stand_for_squares_of_cells():
    x, y = places(GRID, Window(32, 64, 36, 33))
    assert x.tolist() == [-50 + 64 + PLACE / 2, -50 + 96 + PLACE / 2]
    assert y.tolist() == [50 - 32 - PLACE / 2, 50 - 64 - PLACE / 2]


def test_the_steepest_comes_first_and_a_twin_last():
    found = order([view(60, 0), view(2, 0), view(2.5, 0), view(-40, 0), view(0, 50)], 5)
    assert found[0] == 1 and found[-1] == 2 and sorted(found) == [0, 1, 2, 3, 4]


def test_directions_are_spread():
    ring = [view(50 * np.cos(a), 50 * np.sin(a)) for a in np.arange(8) * np.pi / 4]
    found = order([view(0, 0), *ring], 5)
    assert found[0] == 0
    azimuths = sorted((i - 1) * 45 for i in found[1:])
    assert min(np.diff([*azimuths, azimuths[0] + 360])) >= 45


def test_what_shows_nothing_is_never_taken():
    assert order([view(0, 0), view(5000, 0), view(30, 0)], 3) == [0, 2]
    assert order([view(5000, 0)], 3) == []
    # Below the ground: the place would appear in it, mirrored.
    assert order([view(0, 0, z=-200.0), view(0, 0)], 3) == [1]


def test_a_photograph_that_ends_beside_a_place_comes_last():
    beside = view(110, 0)
    assert order([beside, view(0, 0), view(90, 0)], 3) == [1, 2]
    assert order([beside, view(0, 0), view(90, 0)], 3, surroundings=20.0) == [1, 2, 0]


def test_coarse_photographs_come_after_fine_ones():
    assert sorted(order([view(0, 0, z=900.0), view(45, 0), view(-45, 0)], 2)) == [1, 2]


def test_an_oblique_block_gets_what_it_has():
    assert len(order([view(0, -190 + 15 * i, tilt=0.75) for i in range(3)], 8)) == 3


def test_every_place_has_its_own_order():
    points = np.array([[-60.0, 0.0, 0.0], [60.0, 0.0, 0.0]])
    assert preferred(sight([view(-60, 0), view(60, 0)], points, 0.0), 1).tolist() == [[0], [1]]


def test_base_over_height_is_that_of_the_photographs_compared():
    assert base_height([view(-30, 0), view(30, 0)], GRID, 0.0, 8) == pytest.approx(0.3)
    assert base_height([view(-30, 0), view(30, 0), view(0, 0)], GRID, 0.0, 8) == pytest.approx(0.3)
    assert base_height([view(0, 0)], GRID, 0.0, 8) == 1.0


def test_bases_are_bounded():
    assert base_height([view(0, 0), view(1, 0)], GRID, 0.0, 8) == 0.1
    assert base_height([view(-60, 0, z=20.0, tilt=0.0), view(60, 0, z=20.0)], GRID, 0.0, 8) <= 2.0
