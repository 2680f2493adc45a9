"""The published interval of columns: heights of a square put on the same left ray (check 17 of sources/epipolar.md)."""

import numpy as np
import pytest
from scipy import ndimage
from village_pair import normal_case, parallax_of

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.epipolar_window import left_pixels
from orthomill.tasks.geometry.normal_case import intersect_pair
from orthomill.tasks.matching.guided.column_interval import GuidePosts, parallax_intervals
from orthomill.tasks.matching.guided.guided_settings import ColumnInterval

PAIR = normal_case(420)
POSTS = MapGrid(west=-20.0, north=20.0, cell=5.0, rows=50, cols=50)
X, Y = np.meshgrid(*POSTS.centres(Window(0, 0, *POSTS.shape)))
PIXELS = np.random.default_rng(3).uniform(60.0, 260.0, (400, 2))


def hills(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 8.0 * np.sin(x / 25.0) * np.cos(y / 20.0)


def posts(heights: np.ndarray, count: np.ndarray | float = 4.0, spread: float = 0.0) -> GuidePosts:
    middle = heights.astype(np.float32)
    low, high = middle - np.float32(spread), middle + np.float32(spread)
    return GuidePosts(POSTS, middle, low, high, np.broadcast_to(np.float32(count), POSTS.shape).copy())


def true_parallaxes(pixels: np.ndarray) -> np.ndarray:
    """Of pixels that see the hills: the parallax at which the ray's point lies on them."""
    candidates = np.linspace(parallax_of(PAIR, -10.0), parallax_of(PAIR, 10.0), 4001)
    found = []
    for pixel in pixels:
        x, y, z = intersect_pair(PAIR, np.repeat(pixel[None], len(candidates), 0), candidates).T
        found.append(candidates[np.argmin(np.abs(z - hills(x, y)))])
    return np.array(found)


def intervals(guide: GuidePosts, side: float = 20.0, pixels: np.ndarray = PIXELS, **asked) -> np.ndarray:
    return parallax_intervals(PAIR, pixels, guide, ColumnInterval(**asked), side)


def test_the_true_column_lies_in_the_interval():
    truth = true_parallaxes(PIXELS)
    noisy = hills(X, Y) + np.random.default_rng(1).normal(0, 1.0, X.shape)
    low, middle, high = intervals(posts(noisy)).T
    assert ((low <= truth) & (truth <= high)).mean() >= 0.99
    assert (low <= middle).all() and (middle <= high).all()
    low, middle, high = intervals(posts(hills(X, Y))).T
    assert np.abs(middle - truth).max() < 0.5, "the middle one is monoplotted on the guide"


def test_the_ends_lie_on_the_same_left_ray_and_not_at_the_same_place():
    """With X and Y kept, the left column moves too, and so another pair of points would be searched."""
    _, middle, high = intervals(posts(hills(X, Y))).T
    top = intersect_pair(PAIR, PIXELS, high)
    assert np.allclose(left_pixels(PAIR, top), PIXELS, atol=1e-6)
    on_guide = intersect_pair(PAIR, PIXELS, middle)
    kept = np.column_stack([on_guide[:, :2], top[:, 2]])
    away = np.abs(left_pixels(PAIR, kept) - PIXELS).max(axis=1)
    assert np.median(away) > 0.3


def test_the_ends_are_the_extremes_of_the_square():
    heights = np.zeros(POSTS.shape)
    heights[20:30, 20:30] = 6.0
    x, y = POSTS.west + 25.0 * POSTS.cell, POSTS.north - 25.0 * POSTS.cell
    pixel = left_pixels(PAIR, np.array([[x, y, 6.0]]))
    small, large = (intervals(posts(heights), side, pixel)[0] for side in (20.0, 80.0))
    assert np.allclose(small, parallax_of(PAIR, 6.0), atol=0.02)
    assert np.allclose(large, parallax_of(PAIR, np.array([0.0, 6.0, 6.0])), atol=0.02)
    assert np.allclose(
        intervals(posts(heights), 80.0, pixel, extremes="symmetric")[0], parallax_of(PAIR, np.array([0.0, 6.0, 12.0])), atol=0.02
    )


def test_a_cleaner_model_gives_narrower_intervals():
    rng = np.random.default_rng(2)
    widths = [np.median(np.ptp(intervals(posts(hills(X, Y) + rng.normal(0, sigma, X.shape))), axis=1)) for sigma in (0.0, 1.0, 4.0)]
    assert widths[0] < widths[1] < widths[2]
    spread = np.median(np.ptp(intervals(posts(hills(X, Y), spread=3.0)), axis=1))
    assert spread > widths[0] + 4.0, "the points of a post count with their extremes"


def test_a_square_with_too_few_points_is_doubled():
    heights = ndimage.gaussian_filter(np.random.default_rng(5).normal(0, 30, POSTS.shape), 2)
    full, sparse = posts(heights), posts(heights, count=0.0)
    assert np.array_equal(intervals(sparse, 20.0, min_points=1), intervals(full, 80.0), equal_nan=True)
    assert np.array_equal(intervals(full, 20.0, min_points=1), intervals(sparse, 20.0, min_points=1)) is False
    assert np.array_equal(intervals(full, 20.0, min_points=65), intervals(full, 40.0, min_points=1), equal_nan=True)


def test_rays_that_miss_the_guide_have_no_interval():
    away = np.array([[-4000.0, 100.0], [100.0, 9000.0]])
    assert np.isnan(intervals(posts(hills(X, Y)), pixels=away)).all()
    assert np.isnan(intervals(posts(np.full(POSTS.shape, np.nan)))).all()


@pytest.mark.parametrize(("asked", "side"), [({}, 24.0), ({"square": 20.0}, 20.0)])
def test_the_side_follows_from_the_pixel_unless_it_is_given(asked, side):
    assert ColumnInterval(**asked).side(0.5) == side and ColumnInterval(**asked).reach(side) == 2 * side
