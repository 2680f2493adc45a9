"""Triangles in a texture: each has texels of its own, nothing is stretched, and what lies under its own chart gets a place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.projection.model.model_colours import points_of_places, with_margins
from orthomill.tasks.projection.model.unwrapping import MARGIN, neighbours, shelves, unwrapped
from orthomill.tasks.visibility.scanline import NOTHING
from tests.support.solid import wall_and_box as scene


def ball(turns: int = 24, tilts: int = 12) -> np.ndarray:
    """(T, 3, 3)"""
    turn, tilt = np.meshgrid(np.linspace(0, 2 * np.pi, turns + 1), np.linspace(0.05, np.pi - 0.05, tilts + 1))
    points = np.stack([np.cos(turn) * np.sin(tilt), np.sin(turn) * np.sin(tilt), np.cos(tilt)], axis=2).round(12)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    return np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, c, b), (b, c, d))])


def stair(turns: float = 3.0, steps: int = 90) -> np.ndarray:
    """A ramp that winds about an axis: all of it faces upwards, and it lies above itself."""
    turn = np.linspace(0, 2 * np.pi * turns, steps + 1)
    inner, outer = (np.column_stack([r * np.cos(turn), r * np.sin(turn), 0.02 * turn]) for r in (1.0, 2.0))
    upper = np.stack([inner[:-1], outer[:-1], outer[1:]], axis=1)
    return np.concatenate([upper, np.stack([inner[:-1], outer[1:], inner[1:]], axis=1)])


@pytest.mark.parametrize("corners", [ball(), stair(), scene.mesh().corners], ids=["ball", "stair", "wall and box"])
def test_every_triangle_has_its_texels_and_they_are_about_as_large_as_asked(corners):
    laid = unwrapped(corners, 512, 0.01)
    drawn = laid.raster().triangle
    shown = np.bincount(drawn[drawn != NOTHING], minlength=len(corners))
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    share = shown / (area / laid.texel**2)
    # Seen at most 55 degrees aside, or within the smoothing 73; small triangles have too few texels to be counted exactly.
    large = area > 60 * laid.texel**2
    assert large.any() and share[large].min() > 0.25 and share[large].max() < 1.2
    row, col = np.nonzero(drawn != NOTHING)
    own = drawn[row, col]
    points = points_of_places(np.column_stack([col, row]), laid.places[own], corners[own])
    middle, reach = corners[own].mean(axis=1), np.ptp(corners[own], axis=1).max(axis=1)
    assert (np.linalg.norm(points - middle, axis=1) <= reach).all()


def test_no_chart_touches_another():
    laid = unwrapped(ball(), 256, 1e-3)
    drawn = laid.raster().triangle
    chart = np.where(drawn != NOTHING, laid.charts[drawn], -1)
    for shift in range(1, 2 * MARGIN + 1):
        for one, other in ((chart[:, shift:], chart[:, :-shift]), (chart[shift:], chart[:-shift])):
            assert not ((one >= 0) & (other >= 0) & (one != other)).any()


def test_texels_grow_where_the_texture_is_too_small_and_not_otherwise():
    corners = ball()
    assert unwrapped(corners, 512, 0.02).texel == pytest.approx(0.02)
    small = unwrapped(corners, 64, 0.001)
    assert small.texel > 0.04 and small.places.min() >= MARGIN and small.places.max() <= 64 - 1 - MARGIN


def test_neighbours_share_an_edge():
    corners = scene.mesh(2).corners[:8]
    pairs = {tuple(sorted(pair)) for pair in neighbours(corners).tolist()}
    # Four squares of two triangles: four diagonals, and four edges between squares.
    assert len(pairs) == 8
    for one, other in pairs:
        both = {tuple(corner) for corner in corners[one].tolist()} & {tuple(corner) for corner in corners[other].tolist()}
        assert len(both) == 2


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.integers(1, 30), st.integers(1, 30)), min_size=1, max_size=25))
def test_shelves_keep_rectangles_apart(sizes):
    corners = shelves(np.array(sizes), 100)
    if corners is None:
        assert sum(w * h for w, h in sizes) > 2000
        return
    taken = np.zeros((100, 100), int)
    for (col, row), (wide, high) in zip(corners.tolist(), sizes, strict=True):
        taken[row : row + high, col : col + wide] += 1
    assert taken.sum() == sum(w * h for w, h in sizes) and taken.max() == 1


def test_margins_take_the_colour_of_the_nearest_texel():
    texture, known = np.full((20, 20, 3), 128, np.uint8), np.zeros((20, 20), bool)
    known[5:8, 5:8], known[15, 15] = True, True
    texture[5:8, 5:8], texture[15, 15] = 10, 200
    out = with_margins(texture, known)
    assert (out[6, 8:11, 0] == 10).all() and (out[15, 16:19, 0] == 200).all() and (out[0, 19] == 128).all()
    assert np.array_equal(out[known], texture[known])
    assert np.array_equal(with_margins(texture, np.zeros_like(known)), texture)
