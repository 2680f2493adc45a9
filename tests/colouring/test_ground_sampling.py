"""Heights and slopes of ortho pixels against plain twins, and the weight of a colour against its definition."""

from dataclasses import replace

import numpy as np
import pytest
from box_scene import view
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.colouring.sampling.ground_sampling import STEEPEST, Ground, ground_of, sample_photo
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt
from orthomill.tasks.imagery.pyramid import full_to_level

DSM = MapGrid(west=40.0, north=80.0, cell=1.0, rows=24, cols=24)
WHOLE = Window(0, 0, 24, 24)
PHOTO = view("b")


def ortho(divisor: int) -> MapGrid:
    return MapGrid(west=DSM.west, north=DSM.north, cell=1.0 / divisor, rows=24 * divisor, cols=24 * divisor)


def plane(dx: float, dy: float) -> np.ndarray:
    x, y = DSM.centres(WHOLE)
    return (5.0 + dx * (x[None, :] - 50.0) + dy * (y[:, None] - 70.0)).astype(np.float32)


@settings(max_examples=30, deadline=None)
@given(dx=st.floats(-0.6, 0.6), dy=st.floats(-0.6, 0.6), divisor=st.integers(1, 4))
def test_a_plane_is_draped_exactly_with_its_slopes(dx, dy, divisor):
    grid = ortho(divisor)
    inner = Window(divisor, divisor, 22 * divisor, 22 * divisor)
    ground = ground_of(plane(dx, dy), WHOLE, DSM, grid, inner)
    x, y = grid.centres(inner)
    assert np.allclose(ground.z, 5.0 + dx * (x[None, :] - 50.0) + dy * (y[:, None] - 70.0), atol=1e-4)
    assert np.allclose(ground.dx, dx, atol=1e-4) and np.allclose(ground.dy, dy, atol=1e-4)


def test_slopes_are_limited_and_missing_ones_are_zero():
    steep = ground_of(plane(9.0, 12.0), WHOLE, DSM, ortho(1), Window(2, 2, 20, 20))
    assert np.allclose(np.hypot(steep.dx, steep.dy), STEEPEST, rtol=1e-5)
    assert np.allclose(steep.dx / steep.dy, 0.75, rtol=1e-4)
    holed = plane(0.2, 0.1)
    holed[10, 10] = np.nan
    ground = ground_of(holed, WHOLE, DSM, ortho(1), WHOLE)
    around = np.ones((3, 3), bool)
    around[1, 1] = False
    assert not ground.dx[9:12, 9:12][around].any() and not ground.dy[9:12, 9:12][around].any()
    assert ground.dx[5, 5] == pytest.approx(0.2, abs=1e-4)


def _height_by_hand(z: np.ndarray, row: int, col: int, divisor: int) -> float:
    """The rule in words: bilinear between four cells within two cells of height of each other, or on a slope as steep all around,
    else the nearest cell."""
    y, x = (row + 0.5) / divisor - 0.5, (col + 0.5) / divisor - 0.5
    nearest = z[min(max(int(np.floor(y + 0.5)), 0), 23), min(max(int(np.floor(x + 0.5)), 0), 23)]
    r, c = min(max(int(np.floor(y)), 0), 22), min(max(int(np.floor(x)), 0), 22)
    four = z[r : r + 2, c : c + 2].astype(np.float64)
    around = z[max(r - 1, 0) : r + 3, max(c - 1, 0) : c + 3]
    wall = np.ptp(four) > 2.0 and np.nanmax(around) - np.nanmin(around) <= 1.8 * np.ptp(four)
    if np.isnan(nearest) or np.isnan(four).any() or wall:
        return nearest
    s, t = np.clip([x - c, y - r], 0, 1)
    return (1 - t) * ((1 - s) * four[0, 0] + s * four[0, 1]) + t * ((1 - s) * four[1, 0] + s * four[1, 1])


@pytest.mark.parametrize("divisor", [1, 2, 3])
def test_draping_agrees_with_its_plain_twin(divisor):
    rng = np.random.default_rng(divisor)
    z = rng.uniform(0.0, 1.5, (24, 24)).astype(np.float32)
    z[6:12, 8:15] += 9.0
    z[18:20, 3:6] = np.nan
    found = ground_of(z, WHOLE, DSM, ortho(divisor), Window(0, 0, 24 * divisor, 24 * divisor)).z
    expected = [[_height_by_hand(z, row, col, divisor) for col in range(24 * divisor)] for row in range(24 * divisor)]
    np.testing.assert_allclose(found, np.array(expected), rtol=1e-5)
    assert not ((found > 1.6) & (found < 8.9)).any(), "no ramp between the roof and the ground"


def test_a_steep_slope_has_no_steps_within_its_cells():
    """Steps of the nearest cell would show every place of the slope twice, pixel by pixel: a screen."""
    z = np.zeros((24, 24), np.float32) + 4.0 * np.clip(np.arange(24) - 8, 0, 6).astype(np.float32)
    found = ground_of(z, WHOLE, DSM, ortho(2), Window(0, 0, 48, 48)).z[24]
    assert np.diff(found[18:28]) == pytest.approx(2.0, abs=1e-4)
    wall = np.where(np.arange(24) < 12, 0.0, 24.0).astype(np.float32) + np.zeros((24, 1), np.float32)
    sharp = ground_of(wall, WHOLE, DSM, ortho(2), Window(0, 0, 48, 48)).z[24]
    assert set(np.unique(sharp)) == {0.0, 24.0}


def test_a_window_of_heights_gives_what_the_whole_model_gives():
    z = np.random.default_rng(7).normal(5, 0.5, (24, 24)).astype(np.float32)
    window = Window(20, 16, 10, 14)
    whole = ground_of(z, WHOLE, DSM, ortho(2), window)
    part = Window(8, 6, 9, 11)
    cut = ground_of(z[part.slices], part, DSM, ortho(2), window)
    for one, other in ((whole.z, cut.z), (whole.dx, cut.dx), (whole.dy, cut.dy)):
        assert np.array_equal(one, other)


def flat(height: float = 5.0) -> Ground:
    """Level ground that the photo shows to its corners, and more."""
    grid = MapGrid(west=-60.0, north=180.0, cell=1.0, rows=240, cols=240)
    zero = np.zeros((240, 240), np.float32)
    return Ground(grid, Window(0, 0, 240, 240), zero + np.float32(height), zero, zero)


def sampled(ground: Ground, feather: float = 0.0, level: int = 0, photo=PHOTO, seen=None):
    side = -(-420 // 2**level)
    pixels = np.full((side, side, 1), 90, np.uint8)
    visible = np.ones(ground.z.shape, np.uint8) if seen is None else seen
    return sample_photo(photo, PhotoPixelsAt(pixels, Window(0, 0, side, side), level), ground, visible, feather)


def border_distance(ground: Ground) -> np.ndarray:
    x, y = ground.grid.centres(ground.window)
    points = np.column_stack([*(part.ravel() for part in np.meshgrid(x, y)), ground.z.ravel()])
    col, row = PHOTO.project(points).T
    return np.minimum.reduce([col, 419 - col, row, 419 - row]).reshape(ground.z.shape)


def test_the_feather_raises_the_weight_from_the_border():
    ground = flat()
    plain, soft = sampled(ground).weight, sampled(ground, feather=60.0).weight
    border = border_distance(ground)
    use = (plain > 0) & (border > 4)
    share = np.clip(border / 60.0, 0, 1)
    np.testing.assert_allclose((soft / np.where(use, plain, 1))[use], (share**2 * (3 - 2 * share))[use], rtol=2e-3, atol=1e-5)
    assert (use & (border < 50)).sum() > 1000 and (soft[border > 61] == plain[border > 61]).all()


def test_the_worth_is_independent_of_the_pyramid_level():
    fine, coarse = (sampled(flat(), level=level) for level in (0, 2))
    both = (fine.weight > 0) & (coarse.weight > 0)
    assert both.sum() > 20000 and np.array_equal(fine.weight[both], coarse.weight[both])


def test_worth_is_the_square_of_the_scale_for_vertical_rays():
    """Below the centre the area of a cell is (c / depth)^2 cell^2 in pixels."""
    vertical = replace(PHOTO, rotation=np.eye(3), camera=PHOTO.camera.changed(k1=0.0, k2=0.0))
    for height in (0.0, 50.0):
        found = sampled(flat(height), photo=vertical).weight
        depth = PHOTO.centre[2] - height
        assert found.max() == pytest.approx((400.0 / depth) ** 2, rel=2e-3)


def test_hidden_and_unmeasured_pixels_have_no_worth():
    ground = flat()
    ground.z[100:110, 100:110] = np.nan
    seen = np.ones(ground.z.shape, np.uint8)
    seen[60:70] = 0
    found = sampled(ground, seen=seen)
    assert not found.weight[100:110, 100:110].any() and not found.weight[60:70].any()
    assert (found.weight[120, 100:140] > 0).all() and np.allclose(found.colour[found.weight > 0], 90, atol=1e-3)


def test_the_squared_distance_is_one_in_the_corners_of_the_photo():
    found = sampled(flat())
    assert 0.0 <= found.r2[found.weight > 0].min() < 1e-3
    assert 0.8 < found.r2.max() <= 1.0


def test_ground_above_the_camera_is_not_seen():
    assert not sampled(flat(PHOTO.centre[2] + 10.0)).weight.any()


def keys_by_hand(pixels: np.ndarray, col: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Bicubic values (N, bands) at places (N,): the kernel as published, the outermost pixels repeated beyond the border."""
    total = np.zeros((len(col), pixels.shape[2]))
    for k in range(-1, 3):
        for m in range(-1, 3):
            y, x = np.floor(row).astype(int) + k, np.floor(col).astype(int) + m
            weight = keys(row - y) * keys(col - x)
            total += weight[:, None] * pixels[np.clip(y, 0, pixels.shape[0] - 1), np.clip(x, 0, pixels.shape[1] - 1)]
    return total


def keys(t: np.ndarray) -> np.ndarray:
    t = np.abs(t)
    return np.where(t <= 1, 1.5 * t**3 - 2.5 * t**2 + 1, np.where(t < 2, -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2, 0.0))


@pytest.mark.parametrize(("bands", "kind"), [(1, np.uint8), (3, np.uint8), (1, np.uint16), (3, np.uint16), (4, np.uint8)])
@pytest.mark.parametrize("level", [0, 1])
def test_colours_agree_with_their_plain_twin_up_to_the_border(bands, kind, level):
    """The part of the photograph is cut from its middle on one side and ends with it on the others."""
    side = 420 // 2**level
    whole = np.random.default_rng(bands).integers(0, np.iinfo(kind).max, (side, side, bands)).astype(kind)
    part = Window(0, side // 3, side, side - side // 3)
    ground = flat()
    found = sample_photo(PHOTO, PhotoPixelsAt(whole[part.slices], part, level), ground, np.ones(ground.z.shape, np.uint8), 0.0)
    x, y = ground.grid.centres(ground.window)
    col, row = PHOTO.project(np.column_stack([*(a.ravel() for a in np.meshgrid(x, y)), ground.z.ravel()])).T
    shown = np.minimum.reduce([col, 419 - col, row, 419 - row]) >= 0
    col, row = (full_to_level(values, level) for values in (col, row))
    held = shown & (np.floor(col) - 1 >= part.col)
    np.testing.assert_array_equal((found.weight > 0).ravel(), held)
    expected = keys_by_hand(whole.astype(float), col[held], row[held])
    np.testing.assert_allclose(found.colour.reshape(-1, bands)[held], expected, atol=2e-6 * np.iinfo(kind).max)
    assert (col[held] > side - 2).any() and (row[held] < 1).any(), "some places need pixels beyond the border"
