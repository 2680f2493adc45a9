"""Planes found among points with many others before and behind them, and systems on planes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.project import FacadeFound, FittedPlane, PlaneAcross, PlaneOfPoints, PlaneSurface
from orthomill.tasks.orientation.plane.surface_plane import surface_plane

UP = np.tile([0.0, 0.0, 1.0], (8, 1))


def wall(azimuth, seed=0, others=150):
    """Points of an upright wall at y = 50 m, turned by `azimuth` degrees, with others up to 4 m before and behind it, and eight
    projection centres 12 m before it."""
    generator = np.random.default_rng(seed)
    points = np.column_stack([generator.uniform(-8, 8, 400), generator.normal(0, 0.02, 400), generator.uniform(2, 9, 400)])
    points[:others, 1] = generator.uniform(-4, 4, others)
    centres = np.column_stack([np.linspace(-6, 6, 8), np.full(8, -12.0), generator.uniform(1.5, 2, 8)])
    a = np.radians(azimuth)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    return points @ turn.T + (100, 50, 200), centres @ turn.T + (100, 50, 200), turn


@given(st.integers(0, 359), st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_a_facade_is_found_to_the_degree_and_seen_from_the_photographs(azimuth, seed):
    points, centres, turn = wall(azimuth, seed)
    plane = surface_plane(FacadeFound(), points, centres, UP)
    assert plane.rotation[2] @ turn @ (0, -1, 0) == pytest.approx(1.0, abs=2e-4)
    assert plane.rotation @ plane.rotation.T == pytest.approx(np.eye(3)) and np.linalg.det(plane.rotation) == pytest.approx(1.0)
    moved = plane.of(points)
    assert np.median(np.abs(moved[150:, 2])) < 0.1 and (plane.of(centres)[:, 2] > 10).all()
    # Upwards are the heights of the project, to the right is the right of who looks at the wall.
    assert moved[:, 1] == pytest.approx(points[:, 2])
    assert np.corrcoef(moved[:, 0], ((points - (100, 50, 200)) @ turn)[:, 0])[0, 1] > 0.99


def test_a_leaning_wall_is_fitted_where_it_stands():
    points, centres, _ = wall(30.0)
    lean = np.array([[1, 0, 0], [0, np.cos(0.2), -np.sin(0.2)], [0, np.sin(0.2), np.cos(0.2)]])
    middle = points.mean(axis=0)
    plane = surface_plane(FittedPlane(kind="fit"), (points - middle) @ lean.T + middle, centres, UP)
    assert np.median(np.abs(plane.of((points - middle) @ lean.T + middle)[150:, 2])) < 0.03


def test_planes_that_are_given_are_taken():
    points, centres, _ = wall(0.0)
    across = surface_plane(PlaneAcross(kind="normal", point=(100, 49, 0), normal=(0, 5, 0)), points, centres, UP)
    assert across.rotation[2] == pytest.approx((0, -1, 0)), "its front is where the photographs stand"
    assert across.of(np.array([101.0, 49.0, 7.0]))[1:] == pytest.approx((7.0, 0.0))
    corners = ((90, 48, 0), (110, 48, 0), (90, 48, 5))
    three = surface_plane(PlaneOfPoints(kind="points", points=corners), points, centres, UP)
    assert three.rotation == pytest.approx(across.rotation)
    assert three.of(np.array([100.0, 47.0, 3.0]))[2] == pytest.approx(1.0)


def test_a_project_whose_heights_point_downwards_gets_no_wall_that_stands_on_its_head():
    points, centres, _ = wall(0.0)
    upright, turned = (surface_plane(FacadeFound(), points, centres, up) for up in (UP, -UP))
    assert turned.rotation == pytest.approx(upright.rotation * [[-1], [-1], [1]])
    assert turned.of(points)[:, 1] == pytest.approx(-points[:, 2])
    lying = np.tile([1.0, 0.0, 0.0], (8, 1))
    assert surface_plane(FacadeFound(), points, centres, lying).rotation == pytest.approx(upright.rotation), "a portrait format"


def test_a_floor_keeps_north_upwards():
    points, centres, _ = wall(0.0)
    plane = surface_plane(PlaneAcross(kind="normal", point=(100, 50, 199), normal=(0, 0, 1)), points, centres, UP)
    assert plane.rotation == pytest.approx(np.eye(3))


def test_planes_without_points_or_front_are_refused():
    points, centres, _ = wall(0.0)
    with pytest.raises(GeometryError, match="Only 5 tie points"):
        surface_plane(FacadeFound(), points[:5], centres, UP)
    round_it = np.vstack([centres, centres + np.array([0, 24, 0])])
    with pytest.raises(GeometryError, match="both sides of the surface's plane"):
        surface_plane(FacadeFound(), points, round_it, UP)


@pytest.mark.parametrize(
    ("plane", "said"),
    [
        ({"kind": "points", "points": ((0, 0, 0), (1, 1, 1), (2, 2, 2))}, "on one line"),
        ({"kind": "normal", "point": (0, 0, 0), "normal": (0, 0, 0)}, "is \\(0, 0, 0\\)"),
    ],
)
def test_planes_that_are_none_are_mistakes_of_the_workflow(plane, said):
    with pytest.raises(ValidationError, match=said):
        PlaneSurface(kind="plane", plane=plane)
