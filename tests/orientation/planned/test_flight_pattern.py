import numpy as np
import pytest

from orthomill.tasks.orientation.planned.flight_pattern import flight_pattern, strips
from tests.support.scenes.planned_flights import HEIGHT, block, serpentine, turned


def test_parallel_strips_are_a_grid_with_their_overlaps():
    found = flight_pattern(block(*serpentine(4, 8, forward=0.72, side=0.55)))
    assert (found.kind, found.strips) == ("grid", 4)
    assert found.forward == pytest.approx(0.72, abs=1e-6) and found.side == pytest.approx(0.55, abs=1e-6)


@pytest.mark.parametrize("degrees", [17.0, 90.0, 178.0])
def test_overlaps_do_not_depend_on_the_direction_of_the_flight(degrees):
    places, headings = serpentine(4, 8, forward=0.72, side=0.55)
    found = flight_pattern(block(turned(places, degrees), headings + degrees))
    assert (found.kind, found.strips) == ("grid", 4)
    assert found.forward == pytest.approx(0.72, abs=1e-6) and found.side == pytest.approx(0.55, abs=1e-6)


def test_places_that_scatter_as_pilots_do_keep_their_pattern():
    places, headings = serpentine(4, 8)
    found = flight_pattern(block(places + np.random.default_rng(1).normal(0, 1.0, places.shape), headings))
    assert (found.kind, found.strips) == ("grid", 4)
    assert found.forward == pytest.approx(0.7, abs=0.02) and found.side == pytest.approx(0.6, abs=0.02)


def test_one_strip():
    found = flight_pattern(block(*serpentine(1, 12)))
    assert (found.kind, found.strips, found.side) == ("strip", 1, None)


def test_a_strip_flown_to_and_fro_on_one_line_is_one_strip():
    there, headings = serpentine(1, 8)
    found = flight_pattern(block(np.vstack([there, there[::-1]]), np.append(headings, headings + 180)))
    assert (found.kind, found.strips) == ("strip", 1)


def test_strips_across_make_a_cross_flight():
    places, headings = serpentine(4, 8)
    both = np.vstack([places, turned(places, 90.0)])
    found = flight_pattern(block(both, np.append(headings, headings + 90)))
    assert found.kind == "cross" and found.side == pytest.approx(0.6, abs=0.01)


def test_a_long_narrow_block_is_a_corridor():
    assert flight_pattern(block(*serpentine(2, 20))).kind == "corridor"


def test_a_road_with_a_bend_is_a_corridor():
    y = np.arange(12) * 30.0
    places = np.vstack([np.column_stack([0 * y, y]), np.column_stack([y[1:] * 0.8, y[-1] + 0.6 * y[1:]])])
    places = np.column_stack([places, np.full(len(places), HEIGHT)])
    assert flight_pattern(block(places, np.zeros(len(places)))).kind == "corridor"


def test_a_circle_has_neither_strips_nor_overlaps():
    angle = np.arange(24) * 15.0
    places = np.column_stack([70 * np.cos(np.radians(angle)), 70 * np.sin(np.radians(angle)), np.full(24, HEIGHT)])
    found = flight_pattern(block(places, angle + 90.0, pitch=35.0))
    assert (found.kind, found.strips, found.forward, found.side) == ("circle", 0, None, None)


def test_places_at_random_are_free_hand():
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(0, 200, (30, 2)), np.full(30, HEIGHT)])
    assert flight_pattern(block(places, np.zeros(30))).kind == "free"


def test_oblique_photographs_have_no_overlap_on_flat_ground():
    places, headings = serpentine(4, 8)
    assert flight_pattern(block(places, headings, pitch=45.0)).forward is None


def test_a_guessed_height_says_nothing_of_the_overlap_that_it_was_guessed_from():
    assert flight_pattern(block(*serpentine(4, 8), height_from="overlap")).forward is None


def test_strips_end_at_turns():
    path = np.array([(0, 0), (0, 10), (0, 20), (0, 30), (8, 30), (8, 20), (8, 10), (8, 0)], float)
    assert [run.tolist() for run in strips(path)] == [[0, 1, 2, 3], [4, 5, 6, 7]]
