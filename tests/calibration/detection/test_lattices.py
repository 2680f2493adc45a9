"""Lattices of saddles on drawn patterns: complete, cut by the frame, hidden in part, several at once, and none."""

import numpy as np
import pytest
from drawn_boards import GREY, drawn, homography_of, on_grid

from orthomill.tasks.calibration.detection.lattices import lattices


def places(H: np.ndarray, lattice: np.ndarray, near: float = 0.12) -> set[tuple[int, int]]:
    """Column and row of all corners of a lattice, which have to be `near` (in squares) to those of the board."""
    grid = on_grid(H, lattice)
    whole = np.rint(grid)
    assert np.abs(grid - whole).max() < near
    return {(int(col), int(row)) for col, row in whole}


def inner(corners: tuple[int, int], ring: int = 0) -> set[tuple[int, int]]:
    """Column and row of all inner corners; with the ring of outer corners of the squares, which are weaker saddles."""
    return {(col, row) for col in range(-ring, corners[0] + ring) for row in range(-ring, corners[1] + ring)}


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, -70.0])
def test_a_whole_board_is_one_lattice_with_all_its_corners(angle):
    middle = homography_of(18.0, angle, (110.0, 110.0))
    H = middle @ np.array([[1.0, 0.0, -3.0], [0.0, 1.0, -2.0], [0.0, 0.0, 1.0]])
    (lattice,) = lattices(drawn(H, (7, 5), (220, 220)), 12)
    assert inner((7, 5)) <= places(H, lattice) <= inner((7, 5), ring=1)


def test_neighbours_in_the_lattice_are_neighbours_on_the_board():
    H = homography_of(20.0, 15.0, (70.0, 30.0), (0.006, -0.004))
    (lattice,) = lattices(drawn(H, (7, 5), (190, 260)), 12)
    known = np.isfinite(lattice).all(axis=-1)
    grid = np.full(lattice.shape, np.nan)
    grid[known] = np.rint(on_grid(H, lattice))
    for axis in (0, 1):
        step = np.abs(np.diff(grid, axis=axis)).sum(axis=-1)
        assert (step[np.isfinite(step)] == 1.0).all()


def test_a_board_that_the_frame_cuts_gives_the_part_that_is_inside():
    H = homography_of(20.0, 0.0, (-30.0, 40.0))
    (lattice,) = lattices(drawn(H, (9, 6), (170, 200)), 12)
    found = places(H, lattice)
    assert {(col, row) for col, row in inner((9, 6)) if col >= 2} <= found and min(col for col, _ in found) == 2


def test_hidden_corners_are_unknown_and_the_others_stay():
    H = homography_of(20.0, 0.0, (40.0, 40.0))
    image = drawn(H, (7, 6), (190, 220))
    image[74:106, 74:106] = int(GREY)
    (lattice,) = lattices(image, 12)
    grid = on_grid(H, lattice)
    hidden = (np.abs(grid - 2.5) < 0.75).all(axis=1)
    assert not hidden.any() and inner((7, 6)) - places(H, lattice, near=0.35) <= {(2, 2), (2, 3), (3, 2), (3, 3)}


def test_of_several_boards_the_largest_comes_first():
    one, two = homography_of(14.0, 5.0, (40.0, 30.0)), homography_of(14.0, -10.0, (40.0, 150.0))
    image = drawn(two, (4, 4), (230, 190), drawn(one, (7, 5), (230, 190)))
    found = lattices(image, 12)
    assert len(found) == 2
    assert inner((7, 5)) <= places(one, found[0]) and inner((4, 4)) <= places(two, found[1])


def test_lattices_below_the_stated_number_of_corners_are_left_out():
    image = drawn(homography_of(18.0, 0.0, (40.0, 40.0)), (4, 3), (120, 140))
    (lattice,) = lattices(image, 12)
    count = int(np.isfinite(lattice).all(axis=-1).sum())
    assert len(lattices(image, count)) == 1 and lattices(image, count + 1) == []


@pytest.mark.parametrize("kind", ["flat", "stripes", "dots"])
def test_other_patterns_are_no_lattices(kind):
    row, col = np.mgrid[:120, :160]
    patterns = {
        "flat": np.full((120, 160), 90),
        "stripes": np.where(col // 10 % 2, 40, 210),
        "dots": np.where((row % 20 - 10) ** 2 + (col % 20 - 10) ** 2 < 30, 40, 210),
    }
    assert lattices(patterns[kind].astype(np.uint8), 12) == []
