"""Visibility against brute force ray casting, holes, and the rim of occlusions."""

import numpy as np
import pytest
from box_scene import BOX, CENTRES, DSM, ORTHO, heights, sees, view

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.colouring.sampling.ground_sampling import ground_of
from orthomill.tasks.texture.ground.extent import heights_window
from orthomill.tasks.texture.ground.relief import ReliefMap, tile_relief
from orthomill.tasks.visibility.height_model import HeightModel, Targets, bridge_holes, visible_targets, widening_factor

WHOLE = Window(0, 0, DSM.rows, DSM.cols)


def targets(model: np.ndarray, grid: MapGrid = ORTHO, window: Window | None = None) -> Targets:
    window = window or Window(0, 0, grid.rows, grid.cols)
    ground = ground_of(model, WHOLE, DSM, grid, window)
    cols, rows = DSM.pixel(*grid.centres(window))
    return Targets(rows, cols, ground.z, np.hypot(ground.dx, ground.dy))


def points(grid: MapGrid) -> np.ndarray:
    x, y = grid.centres(Window(0, 0, grid.rows, grid.cols))
    return np.column_stack([*(a.ravel() for a in np.meshgrid(x, y)), heights(grid).ravel()])


@pytest.mark.parametrize("grid", [DSM, ORTHO])
@pytest.mark.parametrize("name", CENTRES)
def test_visibility_agrees_with_brute_force(name, grid):
    photo, where = view(name), points(grid)
    inside = photo.contains(photo.project(where), 2.0)
    found = visible_targets(HeightModel(heights(), DSM, WHOLE), photo, targets(heights(), grid), 0.3).ravel() > 0
    true = sees(photo, where)
    assert (inside & ~true).sum() > 10
    assert ((found & inside) == true).mean() >= 0.995
    hidden = inside & ~true
    assert (hidden & ~found).sum() >= 0.75 * hidden.sum()


@pytest.mark.parametrize("way", [1, -1])
def test_a_wall_behind_a_place_hides_nothing(way):
    """The outer half of the cells along the edge of a roof, seen from above the roof: the wall falls away behind them."""
    photo = view("a")
    col, row = (int(place) for place in DSM.pixel(photo.centre[0], photo.centre[1]))
    roof = np.zeros((120, 120), np.float32)
    edge = col + 12 * way
    roof[:, min(col, edge) : max(col, edge) + 1] = 10.0
    place = Targets(np.array([row + 0.25]), edge + way * np.array([-0.4, 0.0, 0.25, 0.45]), np.full((1, 4), 10.0), np.zeros((1, 4)))
    assert visible_targets(HeightModel(roof, DSM, WHOLE), photo, place, 0.3).all()
    ground = Targets(place.rows, edge + way * np.array([0.6, 0.8, 1.0]), np.zeros((1, 3)), np.zeros((1, 3)))
    assert not visible_targets(HeightModel(roof, DSM, WHOLE), photo, ground, 0.3).any()


def _march_by_hand(model: np.ndarray, photo, row: int, col: int, tolerance: float) -> bool:
    """The plain twin: a hundred samples per cell of a bilinear surface, no blocks, no early end."""
    centre = np.array([*DSM.pixel(photo.centre[0], photo.centre[1])[::-1], photo.centre[2]])
    start = np.array([row, col, model[row, col] + tolerance])
    reach = np.abs(centre - start)[:2].max()
    t = np.arange(0.5, min(reach, 60), 0.05) / reach
    path = start + t[:, None] * (centre - start)
    keep = (path[:, :2] >= 0).all(1) & (path[:, 0] <= DSM.rows - 1) & (path[:, 1] <= DSM.cols - 1)
    r, c = np.minimum(np.floor(path[keep, :2]).astype(int), [DSM.rows - 2, DSM.cols - 2]).T
    s, u = path[keep, 0] - r, path[keep, 1] - c
    surface = (1 - s) * ((1 - u) * model[r, c] + u * model[r, c + 1]) + s * ((1 - u) * model[r + 1, c] + u * model[r + 1, c + 1])
    return bool((surface <= path[keep, 2]).all())


def test_the_kernel_agrees_with_its_plain_twin_on_hills():
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:120, 0:120]
    hills = 25 * np.exp(-((x - 55) ** 2 + (y - 60) ** 2) / 120) + 18 * np.exp(-((x - 90) ** 2 + (y - 40) ** 2) / 60)
    hills = hills.astype(np.float32)
    low = view("a")
    photo = type(low)(low.name, low.camera, low.rotation, np.array([-40.0, 70.0, 60.0]))
    flat = Targets(np.arange(120), np.arange(120), hills, np.zeros_like(hills))
    found = visible_targets(HeightModel(hills, DSM, WHOLE), photo, flat, 0.2) > 0
    places = rng.integers(2, 118, (400, 2))
    twin = np.array([_march_by_hand(hills, photo, r, c, 0.2) for r, c in places])
    assert 0.2 < twin.mean() < 0.95
    assert (found[places[:, 0], places[:, 1]] == twin).mean() >= 0.98


def test_a_window_with_its_halo_sees_what_the_whole_sees():
    rough = heights() + np.random.default_rng(1).normal(0, 0.3, DSM.shape).astype(np.float32)
    relief = ReliefMap(tile_relief(rough, WHOLE), DSM)
    for name in "ad":
        whole = visible_targets(HeightModel(rough, DSM, WHOLE), view(name), targets(rough), 0.2)
        core = Window(40, 60, 24, 24)
        window = heights_window(relief, [view(name)], core, 1)
        model = HeightModel(rough[window.slices], DSM, window)
        part = visible_targets(model, view(name), targets(rough, ORTHO, core.scaled(2)), 0.2)
        assert window.height * window.width < 0.3 * rough.size
        assert np.array_equal(part, whole[core.scaled(2).slices])


def test_noise_on_open_ground_hides_nothing():
    noise = np.random.default_rng(2).normal(0, 0.3, DSM.shape).astype(np.float32)
    seen = visible_targets(HeightModel(noise, DSM, WHOLE), view("a"), targets(noise), 0.5)
    assert seen.mean() > 0.999


def test_a_hole_in_a_roof_still_hides_the_ground_behind():
    holed = heights()
    holed[55:65, 52:68] = np.nan
    inside = heights() > 0
    bridged = bridge_holes(holed, 24)
    assert np.nanmax(np.abs(bridged[inside] - BOX[4])) < 0.01
    full = visible_targets(HeightModel(heights(), DSM, WHOLE), view("a"), targets(heights()), 0.3)
    seen = visible_targets(HeightModel(bridged, DSM, WHOLE), view("a"), targets(heights()), 0.3)
    open_hole = visible_targets(HeightModel(holed, DSM, WHOLE), view("a"), targets(heights()), 0.3)
    ground = heights(ORTHO) == 0
    assert (seen[ground] == full[ground]).mean() > 0.9999
    assert seen[ground].sum() <= open_hole[ground].sum()


def _bridge_by_hand(z: np.ndarray, row: int, col: int, gap: int) -> float:
    found = []
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            for step in range(1, gap + 1):
                r, c = row + dr * step, col + dc * step
                if (dr, dc) == (0, 0) or not (0 <= r < z.shape[0] and 0 <= c < z.shape[1]):
                    break
                if np.isfinite(z[r, c]):
                    found.append((1 / (step * np.hypot(dr, dc)), z[r, c]))
                    break
    return np.average([v for _, v in found], weights=[w for w, _ in found]) if found else np.nan


def test_bridging_agrees_with_its_plain_twin_and_leaves_wide_holes():
    rng = np.random.default_rng(4)
    z = rng.normal(100, 5, (30, 30)).astype(np.float32)
    z[rng.random(z.shape) < 0.5] = np.nan
    z[5:25, 5:25] = np.nan
    filled = bridge_holes(z, 4)
    expected = np.array([[z[r, c] if np.isfinite(z[r, c]) else _bridge_by_hand(z, r, c, 4) for c in range(30)] for r in range(30)])
    np.testing.assert_allclose(filled, expected, rtol=1e-5)
    assert np.isnan(filled[15, 15])


def test_the_rim_of_an_occlusion_loses_weight_but_specks_do_not():
    hidden = np.zeros((40, 40), bool)
    hidden[10:20, 10:20] = True
    hidden[30, 30] = True
    factor = widening_factor(hidden, 2.0, 4.0)
    assert factor[15, 21] == 0 and factor[15, 19 + 6] == 1 and 0 < factor[15, 23] < 1
    assert factor[30, 30] == 1
    assert (widening_factor(np.zeros((5, 5), bool), 2, 2) == 1).all()


def test_nothing_is_seen_without_heights():
    empty = np.full(DSM.shape, np.nan, np.float32)
    assert not visible_targets(HeightModel(empty, DSM, WHOLE), view("a"), targets(empty), 0.3).any()
