"""The area of a wall: what belongs to it, and what photographs show far beside and behind it."""

import numpy as np
import pytest

from orthomill.tasks.orientation.plane.wall_area import LEAST_POINTS, shortest_halves, wall_area, wall_points

CENTRES = np.column_stack([np.linspace(-6, 6, 7), np.zeros(7), np.full(7, 8.0)])


def scene(**parts: tuple[float, float, float, float, float, int]) -> tuple[np.ndarray, dict[str, slice]]:
    """Points (N, 3) of parts (west, south, east, north, depth, count), and the rows of each."""
    generator, points, rows, first = np.random.default_rng(5), [], {}, 0
    for name, (west, south, east, north, depth, count) in parts.items():
        box = generator.uniform((west, south), (east, north), (count, 2))
        points.append(np.column_stack([box, depth + generator.normal(0, 0.01, count)]))
        rows[name], first = slice(first, first + count), first + count
    return np.concatenate(points), rows


def test_a_far_background_has_no_part_in_the_area():
    points, rows = scene(wall=(-4, -3, 5, 3, 0, 800), relief=(-1, 0, 2, 2, 2, 200), street=(-34, -12, -16, 2, -5, 120))
    area = wall_area(points, CENTRES)
    assert area == pytest.approx((-4, -3, 5, 3), abs=0.6)
    assert area[0] < -4 and area[2] > 5, "a little more than the points"
    chosen = wall_points(points, CENTRES)
    assert chosen[rows["wall"]].all() and chosen[rows["relief"]].all() and not chosen[rows["street"]].any()


def test_a_wing_and_the_top_of_a_tower_belong_to_the_wall():
    points, _ = scene(wall=(-4, -3, 5, 3, 0, 700), wing=(5, -3, 9, 3, -2, 150), tower=(-1, 3, 1, 30, 0, 100))
    assert wall_area(points, CENTRES) == pytest.approx((-4, -3, 9, 30), abs=2.0)


def test_wrong_points_do_not_widen_the_area():
    points, _ = scene(wall=(-4, -3, 5, 3, 0, 1000), wrong=(-90, -90, 90, 90, 0, 4))
    assert wall_area(points, CENTRES) == pytest.approx((-4, -3, 5, 3), abs=0.6)


def test_of_few_points_there_is_no_area():
    points, _ = scene(wall=(-4, -3, 5, 3, 0, LEAST_POINTS))
    assert wall_area(points, CENTRES) is not None and wall_area(points[1:], CENTRES) is None


def test_the_narrowest_half_ignores_the_other():
    width, middle = shortest_halves(np.array([[0.0, 9.0], [1.0, 7.0], [1.1, 5.0], [1.2, 3.0], [50.0, 1.0]]))
    assert width == pytest.approx([1.2, 6.0]) and middle[0] == pytest.approx(0.6)
