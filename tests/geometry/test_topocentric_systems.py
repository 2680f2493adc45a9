"""East, north, up and the map: closed forms on the central meridian, curvature, convergence, round trips."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Transformer

from orthomill.tasks.geometry.topocentric import Reference, Topocentric, degrees_of, reference_of

UTM = "EPSG:32634"
CENTRAL = Topocentric(Reference(45.0, 21.0, 50.0), UTM)
ASIDE = Topocentric(Reference(45.0, 23.0, 50.0), UTM)
GREEK = Topocentric(Reference(39.36, 22.94, 10.0), "EPSG:2100")


def test_the_reference_point_is_the_origin():
    np.testing.assert_allclose(CENTRAL.to_map(np.zeros((1, 3))), [[500000.0, 0.9996 * 4984944.378, 50.0]], atol=1e-3)


def test_up_is_height_and_east_is_scaled_by_the_map():
    up, east, north = CENTRAL.to_map(np.array([[0, 0, 100.0], [100.0, 0, 0], [0, 100.0, 0]])) - CENTRAL.to_map(np.zeros((1, 3)))
    np.testing.assert_allclose(up, [0, 0, 100.0], atol=1e-6)
    # Lengths on the ground at 50 m shrink to the ellipsoid by 50 m over its radius, and to the map by 0.9996.
    assert east[0] == pytest.approx(100 * 0.9996 * (1 - 50 / 6.38e6), abs=1e-5) and abs(east[1]) < 2e-3
    assert north[1] == pytest.approx(100 * 0.9996 * (1 - 50 / 6.37e6), abs=1e-4) and abs(north[0]) < 1e-6


@pytest.mark.parametrize("distance", [100.0, 1000.0, 5000.0])
def test_the_earth_curves_away_below_the_tangent_plane(distance):
    height = CENTRAL.to_map(np.array([[distance, 0, 0]]))[0, 2] - 50.0
    assert height == pytest.approx(distance**2 / (2 * 6.388e6), rel=2e-3)


def test_on_the_central_meridian_the_axes_are_those_of_the_map():
    np.testing.assert_allclose(CENTRAL.turn(np.zeros(3)), np.eye(3), atol=1e-8)


def test_off_the_central_meridian_north_turns_by_the_convergence():
    """gamma = atan(tan(dlon) sin(lat)) (Snyder 1987, equation 8-9): true north is to the left of grid north here."""
    gamma = np.arctan(np.tan(np.radians(2.0)) * np.sin(np.radians(45.0)))
    np.testing.assert_allclose(ASIDE.turn(np.zeros(3)) @ [0, 1, 0], [-np.sin(gamma), np.cos(gamma), 0], atol=1e-6)


@pytest.mark.parametrize("frame", [CENTRAL, ASIDE, GREEK])
@settings(deadline=None, max_examples=25)
@given(st.tuples(st.floats(-8000, 8000), st.floats(-8000, 8000), st.floats(-200, 3000)))
def test_points_come_back(frame, point):
    points = np.array([point])
    np.testing.assert_allclose(frame.from_map(frame.to_map(points)), points, atol=2e-6)


def test_far_from_the_reference_the_axes_tilt_with_the_plumb_line():
    """3 km east the vertical has turned by 3000 / R about the north axis."""
    turn = CENTRAL.turn(np.array([3000.0, 0.0, 0.0]))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.arcsin(turn[2, 0]) == pytest.approx(3000 / 6.388e6, rel=2e-3)


def test_degrees_are_the_exact_inverse_across_a_shift_of_datum():
    to_map = Transformer.from_crs("EPSG:4326", "EPSG:2100", always_xy=True)
    xy = np.array([[407100.0, 4357010.0], [407300.0, 4357400.0]])
    again = np.column_stack(to_map.transform(*degrees_of(to_map, xy).T))
    np.testing.assert_allclose(again, xy, atol=1e-6)


def test_the_reference_of_a_map_point_lies_there():
    reference = reference_of("EPSG:2100", np.array([407100.0, 4357010.0, 75.0]))
    assert reference.altitude == 75.0
    np.testing.assert_allclose(Topocentric(reference, "EPSG:2100").to_map(np.zeros((1, 3))), [[407100, 4357010, 75]], atol=1e-6)
