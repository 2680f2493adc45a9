"""Which photographs a tile gets: neighbours first, several directions, every corner of the tile."""

import numpy as np
import pytest
from box_scene import CAMERA

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.volume.photograph_choice import base_height, chosen, places, sight
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

GRID = MapGrid(west=-50.0, north=50.0, cell=1.0, rows=100, cols=100)
MIDDLE = Window(40, 40, 20, 20)


def view(x: float, y: float, z: float = 200.0, tilt: float = 0.0, name: str = "") -> View:
    return View(name or f"{x}/{y}", CAMERA, rotation_matrix(tilt, 0.0, 0.0), np.array([x, y, z]))


def order(views: list[View], most: int, window: Window = MIDDLE) -> tuple[int, ...]:
    return chosen(sight(views, places(GRID, window, 0.0)), most)


def test_places_are_spread_over_the_window():
    points = places(GRID, MIDDLE, 7.0)
    assert points.shape == (25, 3) and (points[:, 2] == 7.0).all()
    assert points[:, :2].mean(axis=0) == pytest.approx([0.0, 0.0]) and abs(points[:, :2]).max() == pytest.approx(8.0)


def test_the_steepest_comes_first_and_a_twin_last():
    views = [view(60, 0), view(2, 0), view(2.5, 0), view(-40, 0), view(0, 50)]
    found = order(views, 5)
    assert found[0] == 1 and found[-1] == 2 and sorted(found) == [0, 1, 2, 3, 4]


def test_directions_are_spread():
    ring = [view(50 * np.cos(a), 50 * np.sin(a)) for a in np.arange(8) * np.pi / 4]
    found = order([view(0, 0), *ring], 5)
    assert found[0] == 0
    azimuths = sorted((i - 1) * 45 for i in found[1:])
    assert min(np.diff([*azimuths, azimuths[0] + 360])) >= 45


def test_what_shows_nothing_is_never_taken():
    assert order([view(0, 0), view(5000, 0), view(30, 0)], 3) == (0, 2)
    assert order([view(5000, 0)], 3) == ()
    # Below the ground: the place would appear in it, mirrored.
    assert order([view(0, 0, z=-200.0), view(0, 0)], 3) == (1,)


def test_a_photograph_that_alone_shows_a_corner_is_not_forgotten():
    wide = Window(0, 0, 100, 100)
    crowd = [view(-90 + i, 0) for i in range(6)]
    alone = view(120, 0)
    assert 6 in order([*crowd, alone], 3, wide)


def test_coarse_photographs_come_after_fine_ones():
    assert order([view(0, 0, z=900.0), view(45, 0), view(-45, 0)], 2) in ((1, 2), (2, 1))


def test_an_oblique_block_gets_what_it_has():
    views = [view(0, -190 + 15 * i, tilt=0.75) for i in range(3)]
    assert len(order(views, 8)) == 3


def test_base_over_height_is_that_of_the_photographs_compared():
    assert base_height([view(-30, 0), view(30, 0)], GRID, 0.0, 8) == pytest.approx(0.3)
    assert base_height([view(-30, 0), view(30, 0), view(0, 0)], GRID, 0.0, 8) == pytest.approx(0.3)
    assert base_height([view(0, 0)], GRID, 0.0, 8) == 1.0
