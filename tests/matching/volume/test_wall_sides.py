"""On which side of a wall a cell lies: both surfaces from the heights around, and the photographs decide between them."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from orthomill.tasks.matching.volume.candidates import all_planes
from orthomill.tasks.matching.volume.costs import Choice, PhotographStack
from orthomill.tasks.matching.volume.rectified_photograph import RectifiedPhotograph
from orthomill.tasks.matching.volume.signatures import signatures
from orthomill.tasks.matching.volume.wall_sides import HALF, SPACING, Lookouts, WallSides, decided, wall_sides

LOW, HIGH, PLANES = 6.0, 15.0, 32
HEIGHTS = np.arange(PLANES, dtype=float)


def box(shape=(50, 60), window=(slice(15, 35), slice(20, 45))) -> np.ndarray:
    height = np.full(shape, LOW, np.float32)
    height[window] = HIGH
    return height


def plain_sides(height: np.ndarray, least: float) -> np.ndarray:
    """The same cell by cell (2, rows, cols)."""
    out = np.full((2, *height.shape), np.nan)
    for r, c in np.argwhere(np.isfinite(height)):
        rows, cols = (slice(max(at - 3, 0), at + 4) for at in (r, c))
        near, (y, x) = height[rows, cols], np.indices(height.shape)[:, rows, cols]
        low, high = np.nanmin(near), np.nanmax(near)
        if high - low < least:
            continue
        weight = 1 / (1 + (y - r) ** 2 + (x - c) ** 2) ** 2
        parts = near > low + 0.75 * (high - low), near < low + 0.25 * (high - low)
        between = np.isfinite(near).sum() - sum(part.sum() for part in parts)
        if all(part.sum() >= 3 for part in parts) and between <= 0.2 * np.isfinite(near).sum():
            out[:, r, c] = [(weight * near)[part].sum() / weight[part].sum() for part in parts]
    return out


def test_both_surfaces_are_those_around():
    height = (box() + np.random.default_rng(0).normal(0, 0.1, (50, 60))).astype(np.float32)
    height[:3, :30] = np.nan
    sides = wall_sides(height, 5.0)
    assert np.stack(sides) == pytest.approx(plain_sides(height, 5.0), nan_ok=True, rel=1e-5)
    assert sides.near[25, 17:23].all() and not sides.near[25, :17].any() and not sides.near[25, 23:40].any()
    assert not wall_sides(height, 20.0).near.any()


def test_leaves_and_slopes_are_no_two_surfaces():
    leaves = np.random.default_rng(2).uniform(LOW, HIGH, (50, 60)).astype(np.float32)
    slope = np.add.outer(np.arange(50), 2 * np.arange(60)).astype(np.float32)
    assert not wall_sides(leaves, 3.0).near[3:-3, 3:-3].any() and not wall_sides(slope, 3.0).near[3:-3, 3:-3].any()


def test_heights_between_the_surfaces_belong_to_neither():
    sides = WallSides(np.full((1, 5), HIGH, np.float32), np.full((1, 5), LOW, np.float32))
    height = np.array([[LOW, 9.0, 10.5, 12.0, HIGH]], np.float32)
    assert sides.contradicted(height, np.ones((1, 5), bool))[0].tolist() == [True, True, True, True, False]
    assert sides.contradicted(height, np.zeros((1, 5), bool))[0].tolist() == [False, True, True, True, True]
    nowhere = WallSides(np.full((1, 5), np.nan, np.float32), np.full((1, 5), np.nan, np.float32))
    assert not nowhere.contradicted(height, np.ones((1, 5), bool)).any()


SHIFTS = (0, 1, -1, 2, -2)
"""columns by which the images shift what is higher by one: those of a positive shift look from the left"""
LOOKOUTS = Lookouts(
    np.array([30.0, -1e6, 1e6, -1e6, 1e6]), np.full(5, 25.0), np.array([1e9, 1e6, 1e6, 0.5e6, 0.5e6]), tolerance=1.5
)


def photographs(height: np.ndarray) -> list[RectifiedPhotograph]:
    """Images that see the surface, what is higher before what is lower."""
    rows, cols = height.shape
    texture = gaussian_filter(np.random.default_rng(1).normal(size=(2, rows, cols)), (0, 0.7, 0.7)) * 100
    row, col = np.indices(height.shape)
    found = []
    for shift in SHIFTS:
        first = 2 * PLANES
        image = np.zeros((rows, cols + 2 * first))
        for z, painted in ((LOW, texture[0]), (HIGH, texture[1] + 30)):
            here = height == z
            image[row[here], first + col[here] + int(shift * z)] = painted[here]
        planes = np.column_stack([np.ones(PLANES), first + shift * HEIGHTS, np.zeros(PLANES)])
        found.append(RectifiedPhotograph(signatures(image.astype(np.float32), HALF, SPACING), planes))
    return found


def asked(height: np.ndarray, images: list[RectifiedPhotograph], lookouts: Lookouts) -> np.ndarray:
    stack = PhotographStack.of(images, sum(image.signatures.size for image in images), HALF)
    hidden = np.zeros((len(images), *height.shape), bool)
    choice = Choice(256, np.arange(len(images)).reshape(1, 1, -1), hidden)
    candidates = all_planes(np.ones(height.shape, bool), PLANES)
    return decided(height, wall_sides(height, 3.0), stack, choice, candidates, HEIGHTS, lookouts)


def test_photographs_move_a_displaced_edge_back():
    true = box()
    shrunk = box(window=(slice(15, 35), slice(22, 45)))
    upper = asked(shrunk, photographs(true), LOOKOUTS)
    at = wall_sides(shrunk, 3.0).near
    before, after = ((found != (true == HIGH))[at].mean() for found in (shrunk == HIGH, upper))
    assert after < 0.6 * before and not upper[~at].any()


def test_where_no_photograph_says_anything_heights_stay_on_their_side():
    height = box()
    blank = [
        RectifiedPhotograph(np.full(image.signatures.shape, np.uint32(1 << 31)), image.planes) for image in photographs(height)
    ]
    near = wall_sides(height, 3.0).near
    assert (asked(height, blank, LOOKOUTS) == ((height == HIGH) & near)).all()


def test_photographs_behind_the_wall_have_no_say():
    """Whoever thinks that all of them see past the box finds it larger than it is."""
    true = box()
    past = Lookouts(*(np.full(5, value) for value in (30.0, 25.0, 1e9)), tolerance=1.5)
    grown = [(asked(true, photographs(true), lookouts) & (true == LOW)).sum() for lookouts in (LOOKOUTS, past)]
    assert grown[0] < 0.5 * grown[1]
