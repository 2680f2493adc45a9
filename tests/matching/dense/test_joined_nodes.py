"""Nodes on planes with their neighbours: noise goes down, what bends or breaks stays as it was matched."""

import numpy as np
import pytest

from orthomill.tasks.matching.dense.joined_nodes import joined

SHAPE, NOISE = (40, 60), np.float32(0.05)


def surface(slope: float = 0.04) -> np.ndarray:
    """An inclined plane of parallaxes, px; slope: px per node."""
    row, col = np.indices(SHAPE)
    return (30.0 + slope * col - 0.5 * slope * row).astype(np.float32)


def found(parallax: np.ndarray, slope: float = 0.04, sigma: np.ndarray | None = None) -> np.ndarray:
    sigma = np.where(np.isfinite(parallax), NOISE, np.float32(np.nan)) if sigma is None else sigma
    return joined(parallax, sigma, np.broadcast_to(np.float32([slope, -0.5 * slope]), (*SHAPE, 2)))


def twin(parallax: np.ndarray, sigma: np.ndarray, slope: tuple[float, float], at: tuple[int, int]) -> float:
    """Least squares through the neighbours of one node, the slopes observed as those of the start about the mean place."""
    row, col = np.indices(SHAPE)
    near = (abs(row - at[0]) <= 1) & (abs(col - at[1]) <= 1)
    x, y = (col - at[1])[near], (row - at[0])[near]
    off = parallax[near].astype(float) - parallax[at] - slope[0] * x - slope[1] * y
    kept = np.abs(off) <= 0.5
    x, y, off, weight = x[kept], y[kept], off[kept], 1.0 / (sigma[near][kept].astype(float) ** 2 + 4e-4)
    if len(off) < 4:
        return float(parallax[at])
    weight = weight / weight.sum()
    mx, my, mv = (float(weight @ part) for part in (x, y, off))
    design = np.column_stack([x - mx, y - my])
    normal = design.T @ (weight[:, None] * design) + 0.06 * np.eye(2)
    slopes = np.linalg.solve(normal, design.T @ (weight * (off - mv)))
    moved = mv - slopes @ [mx, my]
    return float(parallax[at] + moved) if abs(moved) <= 2 * sigma[at] else float(parallax[at])


def test_the_kernel_agrees_with_its_twin():
    random = np.random.default_rng(3)
    parallax = (surface() + random.normal(0, 0.2, SHAPE)).astype(np.float32)
    parallax[random.random(SHAPE) < 0.2] = np.nan
    sigma = np.where(np.isfinite(parallax), random.uniform(0.02, 0.3, SHAPE), np.nan).astype(np.float32)
    values = found(parallax, 0.04, sigma)
    places = [(r, c) for r, c in [(0, 0), (39, 59), *random.integers(0, SHAPE, (60, 2))] if np.isfinite(parallax[r, c])]
    for at in places:
        assert values[tuple(at)] == pytest.approx(twin(parallax, sigma, (0.04, -0.02), tuple(at)), abs=1e-5)


@pytest.mark.parametrize("slope", [0.0, 0.04, 0.6])
def test_noise_goes_down_on_a_plane_of_any_slope(slope):
    noise = np.random.default_rng(7).normal(0, NOISE, SHAPE)
    left = found((surface(slope) + noise).astype(np.float32), slope) - surface(slope)
    # A third of the noise of nine independent values; with the one node in twenty that keeps its own, half of it.
    assert left[2:-2, 2:-2].std() < 0.6 * NOISE and abs(left.mean()) < 0.1 * NOISE


def test_a_break_is_not_blurred():
    broken = surface(0.3)
    broken[:, 30:] += 4.0
    assert found(broken, 0.3) == pytest.approx(broken, abs=1e-4)


def test_a_precise_node_keeps_what_its_neighbours_do_not_share():
    bump, sigma = surface(), np.full(SHAPE, NOISE)
    bump[20, 30] += 0.3
    assert found(bump)[20, 30] == bump[20, 30]
    sigma[20, 30] = 0.4
    assert found(bump, sigma=sigma)[20, 30] == pytest.approx(surface()[20, 30], abs=0.02)


def test_a_node_without_parallax_remains_without_and_harms_none():
    holed = surface()
    holed[10:14, 10:20] = np.nan
    values, known = found(holed), np.isfinite(holed)
    assert np.array_equal(np.isfinite(values), known)
    assert values[known] == pytest.approx(holed[known], abs=1e-4)
