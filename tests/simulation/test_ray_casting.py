"""Rays against a brute march, walls, visibility, and photos that fit together."""

from dataclasses import replace

import numpy as np
import pytest
from small_block import FLIGHT, ground_under, scene, site, whole

from orthomill.schemas.raster import Window
from orthomill.schemas.truth import OPEN_MATERIALS
from orthomill.tasks.simulation.flight import BLOCK, exposure, views
from orthomill.tasks.simulation.rendering import HALO, Film, blur, cast, expose, render
from orthomill.tasks.simulation.scene.traversal import NOTHING, TOP, WALL, Ray, columns_of, first_hit, is_free, safe_start, widened
from orthomill.tasks.simulation.scene.vehicles import vehicles_of, with_vehicles
from orthomill.tasks.simulation.simulated_tiles import see, sight_window

CELL = 0.5
FILM = Film(exposure(FLIGHT, 1), 2.0, 2009)


def blocks_on_a_slope(rows=64, cols=72):
    generator = np.random.default_rng(1)
    y, x = np.mgrid[0:rows, 0:cols] * CELL
    height = 10.0 + 0.2 * x - 0.1 * y + 0.3 * np.sin(x / 3.0)
    for _ in range(7):
        row, col = generator.integers(4, rows - 14), generator.integers(4, cols - 14)
        height[row : row + 9, col : col + 7] = height[row, col] + generator.uniform(4.0, 15.0)
    return height.astype(np.float32)


def marched(columns, u0, v0, z0, du, dv, start, end):
    """Steps of a millimetre along the ray, and the plane of the cell under each: the depth of the first step that is below it."""
    s = np.arange(start, end, 0.001)
    u, v = u0 + s * du, v0 + s * dv
    col, row = np.floor(u).astype(int), np.floor(v).astype(int)
    inside = (col >= 0) & (row >= 0) & (col < columns.tops.shape[1]) & (row < columns.tops.shape[0])
    s, u, v, col, row = s[inside], u[inside], v[inside], col[inside], row[inside]
    z, gu, gv = columns.tops[row, col].astype(np.float64).T
    below = np.flatnonzero(z0 - s < z + gu * (u - col - 0.5) + gv * (v - row - 0.5))
    return (None, None) if not len(below) else (s[below[0]], (row[below[0]], col[below[0]]))


def test_hits_agree_with_a_brute_march():
    columns = columns_of(blocks_on_a_slope(), Window(0, 0, 64, 72), CELL)
    generator = np.random.default_rng(5)
    top = float(columns.highest.max())
    high = widened(columns.highest)
    kinds = []
    for _ in range(250):
        u, v = generator.uniform(6.0, 60.0, 2)
        du, dv = generator.uniform(-1.6, 1.6, 2)
        z0 = 400.0
        u0, v0 = u - du * (z0 - 15.0), v - dv * (z0 - 15.0)
        start = safe_start(columns, high, Ray(u0, v0, z0, du, dv), z0 - top)
        kind, s, row, col = first_hit(columns, Ray(u0, v0, z0, du, dv), start, z0)
        brute, cell = marched(columns, u0, v0, z0, du, dv, z0 - top, z0)
        kinds.append(kind)
        if kind == NOTHING:
            continue
        assert abs(s - brute) < 0.0025
        assert kind == TOP or (row, col) == cell
    assert kinds.count(WALL) > 15 and kinds.count(TOP) > 100


def test_a_hit_does_not_depend_on_the_window():
    height = blocks_on_a_slope(96, 96)
    whole_columns = columns_of(height, Window(0, 0, 96, 96), CELL)
    part = Window(2 * BLOCK, BLOCK, 8 * BLOCK, 9 * BLOCK)
    columns = columns_of(height[part.slices], part, CELL)
    generator = np.random.default_rng(6)
    for _ in range(200):
        u, v = generator.uniform(36.0, 60.0, 2)
        du, dv = generator.uniform(-0.8, 0.8, 2)
        u0, v0 = u - du * 380.0, v - dv * 380.0
        first = first_hit(whole_columns, Ray(u0, v0, 400.0, du, dv), 400.0 - float(whole_columns.highest.max()), 400.0)
        second = first_hit(columns, Ray(u0, v0, 400.0, du, dv), 400.0 - float(columns.highest.max()), 400.0)
        assert first[:2] == second[:2]
        assert first[0] == NOTHING or (first[2] - part.row, first[3] - part.col) == second[2:]


def test_visibility_agrees_with_the_first_hit():
    columns = columns_of(blocks_on_a_slope(), Window(0, 0, 64, 72), CELL)
    top = float(columns.highest.max())
    generator = np.random.default_rng(8)
    hidden = 0
    for _ in range(400):
        row, col = generator.integers(12, 52, 2)
        z = float(columns.tops[row, col, 0])
        du, dv = generator.uniform(-1.6, 1.6, 2)
        depth = 400.0 - z
        u0, v0 = col + 0.5 - du * depth, row + 0.5 - dv * depth
        free = is_free(columns, Ray(u0, v0, 400.0, du, dv), depth, 400.0 - top)
        kind, s, _, _ = first_hit(columns, Ray(u0, v0, 400.0, du, dv), 400.0 - top, 400.0)
        if kind == NOTHING:
            continue
        hidden += not free
        assert free == (depth - s < 0.08)
    assert 30 < hidden < 300


def test_a_photo_is_the_same_in_two_tilings():
    view, pixels = views(FLIGHT)[1], Window(200, 180, 150, 200)
    image = render(scene(), view, FILM, pixels, ground_under(1, pixels))
    for part in (Window(200, 180, 70, 110), Window(255, 300, 95, 80)):
        tile = render(scene(), view, FILM, part, ground_under(1, part))
        inside = slice(part.row - 200, part.row - 200 + part.height), slice(part.col - 180, part.col - 180 + part.width)
        assert np.array_equal(tile, image[inside])


@pytest.mark.parametrize("corner", [(0, 0), (0, 549), (549, 0), (549, 549)])
def test_photos_are_full_to_their_corners(corner):
    pixels = Window(*corner, 50, 50)
    for number, view in enumerate(views(FLIGHT)):
        light = cast(scene(), view, pixels.grown(HALO), ground_under(number, pixels))
        assert light.min() > 4.0


def test_the_true_orthoimage_agrees_with_the_photo_to_a_tenth_of_a_pixel():
    view, grid = views(FLIGHT)[1], site().grid
    pixels = Window(150, 150, 300, 300)
    light = blur(cast(scene(), view, pixels.grown(HALO), ground_under(1, pixels)), 0.45).mean(axis=2)
    col, row = grid.pixel(view.centre[0], view.centre[1])
    window = Window(int(row) - 60, int(col) - 60, 120, 120)
    wide = sight_window(site(), window)
    seen = see(whole().surface.height[wide.slices], site(), window, wide) >> 1 & 1
    x, y = (part.ravel() for part in np.meshgrid(*grid.centres(window)))
    at = view.project(np.column_stack([x, y, whole().surface.height[window.slices].ravel()]))
    open_ground = np.isin(whole().surface.material[window.slices], OPEN_MATERIALS).ravel()
    col, row = at[:, 0] - pixels.col, at[:, 1] - pixels.row
    use = open_ground & (seen.ravel() > 0) & (col > 2) & (row > 2) & (col < 297) & (row < 297)
    assert use.sum() > 5000
    truth = whole().colours[window.slices].mean(axis=2).ravel()[use]
    shift_col, shift_row, correlation = _shift(light, col[use], row[use], truth)
    assert abs(shift_col) < 0.1 and abs(shift_row) < 0.1 and correlation > 0.9


def _shift(image, col, row, truth):
    """The shift (col, row) in px by which the image at (col, row) fits `truth` best, from its gradients, and the correlation."""
    i, j = np.floor(col).astype(int), np.floor(row).astype(int)
    fx, fy = col - i, row - j
    above = image[j, i] * (1 - fx) + image[j, i + 1] * fx
    below = image[j + 1, i] * (1 - fx) + image[j + 1, i + 1] * fx
    value = above * (1 - fy) + below * fy
    gx = (image[j, i + 2] - image[j, i - 1]) / 3.0
    gy = (image[j + 2, i] - image[j - 1, i]) / 3.0
    design = np.column_stack([gx, gy, value, np.ones(len(value))])
    solution = np.linalg.lstsq(design, truth, rcond=None)[0]
    return solution[0] / solution[2], solution[1] / solution[2], np.corrcoef(value, truth)[0, 1]


def test_a_wall_shows_plaster_and_not_the_roof():
    grid, window, painted = ground_under(1, Window(0, 0, 599, 599))
    red = painted.colours.copy()
    red[painted.surface.building > 0] = (255, 0, 0)
    view = views(FLIGHT)[1]
    houses = scene().buildings
    walls = 0
    for number in range(len(houses)):
        foot = np.array([houses.x[number], houses.y[number], houses.eaves[number]])
        col, row = view.project(foot[None])[0]
        if not (20 < col < 578 and 20 < row < 578):
            continue
        pixels = Window(int(row) - 18, int(col) - 18, 37, 37)
        light = cast(scene(), view, pixels, (grid, window, replace(painted, colours=red)))
        plain = cast(scene(), view, pixels, (grid, window, replace(painted, colours=np.zeros_like(red))))
        walls += int(((plain.mean(axis=2) > 40) & (light[..., 0] - plain[..., 0] < 1.0)).sum())
    assert walls > 100


def test_vehicles_are_elsewhere_in_every_photo_and_on_bare_ground():
    first, second = vehicles_of(scene(), 0), vehicles_of(scene(), 1)
    assert len(first) > 15
    nearest = np.hypot(first[:, None, 0] - second[None, :, 0], first[:, None, 1] - second[None, :, 1]).min(axis=1)
    assert (nearest > 2.0).mean() > 0.6
    grid = site().grid
    window = Window(0, 0, *grid.shape)
    driven = with_vehicles(whole(), grid, window, first)
    lifted = driven.surface.height > whole().surface.height
    assert lifted.sum() > 300
    assert np.isin(whole().surface.material[lifted], OPEN_MATERIALS).all()
    assert (driven.colours != whole().colours).any(axis=2)[~lifted].sum() == 0


def test_the_lens_agrees_with_a_plain_gaussian():
    light = np.random.default_rng(2).uniform(0.0, 255.0, (12, 14, 3)).astype(np.float32)
    weights = np.exp(-0.5 * (np.arange(-HALO, HALO + 1) / 0.45) ** 2)
    kernel = np.outer(weights, weights) / weights.sum() ** 2
    plain = sum(kernel[j, i] * light[j : j + 8, i : i + 10] for j in range(5) for i in range(5))
    assert np.allclose(blur(light, 0.45), plain, atol=1e-3)


def test_noise_has_the_sigma_asked_for_and_gain_does_what_it_says():
    view = views(FLIGHT)[1]
    light = np.full((200, 200, 3), 100.0, np.float32)
    exposed = expose(light, FILM, view, Window(200, 200, 200, 200)).astype(float)
    quiet = expose(light, replace(FILM, noise_sigma=0.0), view, Window(200, 200, 200, 200)).astype(float)
    assert (exposed - quiet).std() == pytest.approx(2.0, abs=0.06)
    assert np.corrcoef((exposed - quiet)[..., 0].ravel(), (exposed - quiet)[..., 1].ravel())[0, 1] == pytest.approx(0.0, abs=0.03)
    expected = FILM.exposure.offset + 100.0 * np.array(FILM.exposure.gain)
    assert np.allclose(quiet[99, 99], expected, atol=1.5)
    corner = expose(light, replace(FILM, noise_sigma=0.0), view, Window(0, 0, 200, 200)).astype(float)
    fall = FILM.exposure.vignetting * 100.0 * FILM.exposure.gain[0]
    assert quiet[99, 99, 0] - corner[0, 0, 0] == pytest.approx(fall, abs=1.5)
