"""From nodes to cells: planes are reproduced, spikes leave, tiles agree bit for bit, noise is not added."""

import cv2
import numpy as np
import pytest

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.tasks.dsm_check.areas import block_size, blocks, fitted_trend, suspicious_areas
from orthomill.tasks.dsm_check.correction_map import (
    CorrectionMap,
    CorrectionNodes,
    clearly_wrong,
    corrected_heights,
    detectable_error,
    interpolate,
    node_points,
    share_applied,
    without_spikes,
)
from orthomill.tasks.dsm_check.nodes import BANDS, DH, OUTCOME, SIGMA
from orthomill.tasks.dsm_check.statistics import added, count, summarised

GRID = CorrectionNodes(step=4, pixels_per_cell=1, radius=8.0, move=20.0, window=11.0)


def nodes(dh, sigma=0.1):
    """Nodes (rows, cols, bands) with corrections dh (rows, cols), each at its node."""
    out = np.zeros((*dh.shape, len(BANDS)), np.float32)
    out[..., DH], out[..., SIGMA], out[..., OUTCOME] = dh, sigma, Outcome.CONVERGED
    return out


def scattered(seed=0, rows=40, cols=50):
    random = np.random.default_rng(seed)
    one = nodes(random.normal(0, 1, (rows, cols)))
    one[..., 1:3] = random.normal(0, 3, (rows, cols, 2))
    one[random.random((rows, cols)) < 0.3, DH] = np.nan
    return one


def test_a_plane_is_reproduced():
    row, col = np.indices((30, 30))
    points = node_points(nodes(0.3 * col - 0.1 * row), (0, 0), GRID)
    out = interpolate(points, Window(0, 0, 120, 120), GRID)
    r, c = np.indices((120, 120))
    truth = 0.3 * (c - 2) / 4 - 0.1 * (r - 2) / 4
    inner = np.s_[8:-8, 8:-8]
    assert np.abs(out.dh - truth)[inner].max() < 0.03
    assert np.nanmax(np.abs(out.dh - truth)) < 0.6
    assert out.sigma[inner] == pytest.approx(0.1, abs=0.12)


def test_far_cells_stay_unknown():
    points = np.array([[10.0, 10.0, 1.0, 0.1], [10.0, 14.0, 1.0, 0.1], [14.0, 10.0, 1.0, 0.1]])
    out = interpolate(points, Window(0, 0, 40, 40), GRID)
    assert np.isfinite(out.dh[11, 11]) and out.dh[11, 11] == pytest.approx(1.0)
    assert np.isnan(out.dh[30, 30]) and np.isnan(out.dh[10, 3])


def test_against_a_plain_twin():
    """One cell by a weighted least-squares plane in numpy, with the same small ridge."""
    points = node_points(scattered(), (0, 0), GRID)
    out = interpolate(points, Window(64, 64, 64, 64), GRID)
    y, x = points[:, 0] - 90, points[:, 1] - 100
    w = np.clip(1 - np.hypot(x, y) / 8.0, 0, None) ** 2
    mx, my, mz = (np.average(v, weights=w) for v in (x, y, points[:, 2]))
    d = np.column_stack([x - mx, y - my])
    normal = (d * w[:, None]).T @ d / w.sum() + np.eye(2) * 0.64
    slope = np.linalg.solve(normal, (d * w[:, None]).T @ (points[:, 2] - mz) / w.sum())
    assert out.dh[90 - 64, 100 - 64] == pytest.approx(mz - slope @ (mx, my), abs=1e-5)


@pytest.mark.parametrize(("step", "radius", "side"), [(4, 6.0, 11), (4, 12.0, 11), (8, 12.0, 11), (4, 6.0, 21), (4, 6.0, 3)])
def test_standard_errors_hold_for_nodes_whose_windows_overlap(step, radius, side):
    """Monte Carlo: the error of a node is the mean of white noise in its window, as that of a match is."""
    grid = CorrectionNodes(step=step, pixels_per_cell=1, radius=radius, move=20.0, window=float(side))
    rng, count = np.random.default_rng(side), 60
    ratios = []
    for _ in range(4):
        noise = cv2.blur(rng.normal(0, side, (count * step, count * step)), (side, side))
        made = nodes(0.1 * noise[step // 2 :: step, step // 2 :: step], 0.1)
        out = interpolate(node_points(made, (0, 0), grid), Window(0, 0, count * step, count * step), grid)
        ratios.append((out.dh / out.sigma)[32:-32, 32:-32])
    ratio = np.abs(np.concatenate(ratios))
    assert 0.62 < (ratio < 1).mean() < 0.78 and 0.93 < (ratio < 2).mean() < 0.985 and (ratio < 3).mean() > 0.99


@pytest.mark.parametrize("significance", [3.0, 5.0])
def test_the_smallest_detectable_error_is_found_in_95_percent(significance):
    """Monte Carlo: an error of just that size under noise, half of the cells too high and half too low."""
    rng = np.random.default_rng(8)
    sigma = rng.uniform(0.02, 0.3, (300, 300)).astype(np.float32)
    sign = np.where(rng.random(sigma.shape) < 0.5, 1.0, -1.0)
    dh = sign * detectable_error(sigma, significance) + rng.normal(0, 1, sigma.shape) * sigma
    assert (sign * dh > significance * sigma).mean() == pytest.approx(0.95, abs=0.005)
    assert np.isnan(detectable_error(np.array([np.nan]), significance)).all()


def test_scatter_beyond_the_errors_of_the_nodes_makes_the_plane_uncertain():
    dh = np.where(np.indices((30, 30)).sum(axis=0) % 2, 1.0, -1.0)
    out = interpolate(node_points(nodes(dh, 0.1), (0, 0), GRID), Window(40, 40, 40, 40), GRID)
    assert np.median(out.sigma) > 0.8


@pytest.mark.parametrize("size", [64, 128])
def test_tiles_agree_with_the_whole(size):
    everything = scattered()
    shape = 160, 200
    whole = interpolate(node_points(without_spikes(everything), (0, 0), GRID), Window(0, 0, *shape), GRID)
    for tile in tiles_of(shape, size):
        w = tile.window
        near = Window(w.row // 4, w.col // 4, -(-w.height // 4), -(-w.width // 4)).grown(GRID.halo).clipped((40, 50))
        part = interpolate(node_points(without_spikes(everything[near.slices]), (near.row, near.col), GRID), w, GRID)
        inner = np.s_[:]
        np.testing.assert_array_equal(part.dh[inner], whole.dh[w.slices])
        np.testing.assert_array_equal(part.sigma[inner], whole.sigma[w.slices])


def test_what_is_wrong_fills_a_square_to_one_side():
    dh, sigma = np.zeros((40, 40), np.float32), np.full((40, 40), 0.1, np.float32)
    dh[2, 2], dh[10, 2:12], dh[20:22, 4:10] = 5.0, 5.0, -5.0  # a cell, a strip of one, six by two
    dh[30:34, 5], dh[30:34, 6] = 5.0, -5.0  # two strips that contradict each other
    wrong = clearly_wrong(CorrectionMap(dh, sigma), 5.0)
    assert wrong[20:22, 4:10].all() and wrong.sum() == 12
    dh[~wrong] = np.nan
    assert not clearly_wrong(CorrectionMap(dh, sigma), 60.0).any()


@pytest.mark.parametrize("size", [8, 20])
def test_tiles_agree_on_what_is_wrong(size):
    dh = np.random.default_rng(5).normal(0, 1, (40, 48)).astype(np.float32) + 1.2
    found = CorrectionMap(dh, np.ones_like(dh))
    whole = clearly_wrong(found, 1.0)
    assert 0.1 < whole.mean() < 0.9
    for tile in tiles_of(dh.shape, size):
        wide = tile.window.grown(1).clipped(dh.shape)
        part = clearly_wrong(CorrectionMap(found.dh[wide.slices], found.sigma[wide.slices]), 1.0)
        np.testing.assert_array_equal(part[tile.window.within(wide).slices], whole[tile.window.slices])


def test_spikes_leave_and_steps_stay():
    dh = np.zeros((20, 20))
    dh[:, 10:] = 3.0
    dh[5, 5] = 2.0
    clean = without_spikes(nodes(dh))
    assert np.isnan(clean[5, 5, DH]) and clean[5, 5, OUTCOME] == Outcome.INCONSISTENT
    assert np.isfinite(clean[2:-2, :, DH]).sum() == 16 * 20 - 1
    lonely = np.full((9, 9), np.nan)
    lonely[4, 4] = 0.0
    assert np.isnan(without_spikes(nodes(lonely))[..., DH]).all()


def test_noise_is_not_added_but_errors_are():
    correction = CorrectionMap(np.array([[0.1, -0.29, 0.6, -5.0, np.nan]], np.float32), np.full((1, 5), 0.1, np.float32))
    heights = np.full((1, 5), 50.0, np.float32)
    share = share_applied(correction, "significant", 3.0)
    assert share[0, 0] == 0 and share[0, 2] == share[0, 3] == 1 and share[0, 4] == 0 and 0 < share[0, 1] < 1
    out = corrected_heights(heights, correction, share)
    assert out[0, 0] == 50 and out[0, 3] == 45 and out[0, 4] == 50
    assert corrected_heights(heights, correction, share_applied(correction, "all", 3.0))[0, 0] == pytest.approx(50.1)
    assert (corrected_heights(heights, correction, share_applied(correction, "none", 3.0)) == 50).all()
    assert np.isnan(corrected_heights(np.full((1, 5), np.nan, np.float32), correction, share)).all()


def test_statistics_add_up():
    random = np.random.default_rng(4)
    dh = random.normal(0.3, 0.5, 5000).astype(np.float32)
    dh[::50] = np.nan
    sigma = np.full(5000, 0.5, np.float32)
    whole = summarised(added([count(part, s, 2.0) for part, s in zip(np.split(dh, 5), np.split(sigma, 5), strict=True)]), 2.0)
    good = dh[np.isfinite(dh)].astype(float)
    assert whole.number == len(good)
    assert whole.mean == pytest.approx(good.mean(), abs=1e-5) and whole.std == pytest.approx(good.std(), abs=1e-5)
    assert whole.median == pytest.approx(np.median(good), abs=0.011)
    assert whole.nmad == pytest.approx(1.4826 * np.median(np.abs(good - np.median(good))), abs=0.02)
    assert whole.within_1 == pytest.approx((np.abs(good) <= 0.5).mean())
    assert summarised(added([]), 2.0).number == 0 and np.isnan(summarised(added([]), 2.0).mean)


def test_trend_and_areas():
    """A tilt is a trend and not an area; two blocks of error are areas with place, sign and size."""
    grid = MapGrid(west=1000.0, north=2000.0, cell=0.5, rows=400, cols=480)
    x, y = np.meshgrid(*grid.centres(Window(0, 0, 400, 480)))
    dh = 0.004 * (x - 1120)
    dh = dh + np.where(np.hypot(x - 1060, y - 1950) < 12, -2.0, 0) + np.where(np.hypot(x - 1200, y - 1850) < 9, 1.5, 0)
    dh[:, 300:310] = np.nan
    coarse = np.concatenate([blocks(dh[:200], np.full((200, 480), 0.1), 8), blocks(dh[200:], np.full((200, 480), 0.1), 8)])
    trend, plane = fitted_trend(coarse, grid, 8)
    assert trend.east == pytest.approx(4.0, abs=0.1) and abs(trend.north) < 0.1 and trend.range == pytest.approx(0.96, abs=0.05)
    areas = suspicious_areas(coarse, plane, grid, 8, 3.0)
    assert len(areas) == 2
    assert np.hypot(areas[0].x - 1060, areas[0].y - 1950) < 1.5 and areas[0].dh == pytest.approx(-1.8, abs=0.3)
    assert np.hypot(areas[1].x - 1200, areas[1].y - 1850) < 1.5 and areas[1].dh > 1.0
    assert areas[0].area == pytest.approx(np.pi * 144, rel=0.3)
    assert block_size((4000, 4000)) == 8 and block_size((30000, 200)) == 32 and block_size((10**6, 10)) == 64


def test_an_empty_check_has_no_trend():
    grid = MapGrid(west=0, north=0, cell=1.0, rows=64, cols=64)
    coarse = blocks(np.full((64, 64), np.nan), np.full((64, 64), np.nan), 8)
    trend, plane = fitted_trend(coarse, grid, 8)
    assert trend.range == 0 and not suspicious_areas(coarse, plane, grid, 8, 3.0)
