"""The published experiments of the check (sources/surface_check.md#results, tables 4.14, 4.19 to 4.22), where a formula
gives what the tables printed."""

import numpy as np
import pytest
from scipy.stats import norm

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.dsm_check.areas import blocks, fitted_trend
from orthomill.tasks.dsm_check.correction_map import CorrectionNodes, interpolate
from orthomill.tasks.dsm_check.height_correction import Centres, PlanCorrection, RayCorrection, correct
from orthomill.tasks.dsm_check.statistics import Summary, added, count, summarised

CENTRES = Centres(np.array([10000.0, 10000.0, 1900.0]), np.array([11104.0, 10000.0, 1900.0]))
"""table 4.3"""
PIXEL = 0.25
NORMAL = norm.ppf((np.arange(200_000) + 0.5) / 200_000)
"""deviates of the normal law, evenly spaced in probability"""


def surface(x, y):
    """Equation 4.1 of sources/matching.md."""
    u, v = x - 10552, y - 10000
    waves = 15 * (np.sin(np.pi * u / 400) + np.sin(np.pi * v / 400)) + 6 * (np.sin(np.pi * u / 90) + np.sin(np.pi * v / 90))
    return 100 + 0.01 * u - 0.01 * v + waves


def deformation(x, y):
    """Equation 4.19: -39.76 to 41.10 m."""
    return -0.02 * (x - 10552) + 0.02 * (y - 10000)


def wrong(x, y):
    return surface(x, y) + deformation(x, y)


def nodes(step=24 * PIXEL, margin=60.0):
    x, y = np.meshgrid(np.arange(9752 + margin, 11352 - margin, 8 * step), np.arange(8735 + margin, 11265 - margin, 8 * step))
    return np.column_stack([x.ravel(), y.ravel(), surface(x.ravel(), y.ravel())])


def seen_on_wrong(truth, centre):
    """Places on the deformed model on the rays through the true points, by bisection."""
    low, high = np.full(len(truth), 0.9), np.full(len(truth), 1.1)
    for _ in range(60):
        t = (low + high) / 2
        p = centre + t[:, None] * (truth - centre)
        above = p[:, 2] > wrong(p[:, 0], p[:, 1])
        low, high = np.where(above, t, low), np.where(above, high, t)
    p = centre + low[:, None] * (truth - centre)
    return np.column_stack([p[:, :2], wrong(p[:, 0], p[:, 1])])


def test_check_values_of_the_published_surface():
    """Check 1."""
    values = {(10552, 10000): 100.0, (11000, 10500): 77.8612, (10100, 9300): 123.3191, (10552, 10200): 116.8567}
    for (x, y), z in values.items():
        assert surface(x, y) == pytest.approx(z, abs=5e-5)


def test_the_published_deformation_has_the_published_range():
    x, y = np.array([9752.0, 11352.0]), np.array([8735.0, 11265.0])
    grid = deformation(*np.meshgrid(x, y))
    assert grid.min() == pytest.approx(-41.3, abs=0.1) and grid.max() == pytest.approx(41.3, abs=0.1)


@pytest.mark.parametrize("correction", [RayCorrection(), PlanCorrection()], ids=["rays", "plan"])
def test_forty_metres_of_deformation_are_recovered_without_noise(correction):
    """Check 21: better than 1e-6 m, in one step."""
    truth = nodes()
    left, right = (seen_on_wrong(truth, centre) for centre in (CENTRES.left, CENTRES.right))
    found = correct(left, right, CENTRES, correction, PIXEL)
    assert np.abs(found.points - truth)[found.accepted].max() < 1e-6
    assert found.accepted.mean() > 0.9


def test_matching_noise_gives_the_published_accuracy():
    """Section 4.4.1 found an RMSE of 0.036 m; matching errors of 0.08 px per axis explain it."""
    rng = np.random.default_rng(4)
    truth = nodes()
    left, right = (seen_on_wrong(truth, centre) for centre in (CENTRES.left, CENTRES.right))
    right[:, :2] += rng.normal(0, 0.08 * PIXEL, (len(right), 2))
    right[:, 2] = wrong(right[:, 0], right[:, 1])
    found = correct(left, right, CENTRES, RayCorrection(), PIXEL)
    dz = (found.points[:, 2] - surface(found.points[:, 0], found.points[:, 1]))[found.accepted]
    assert np.sqrt((dz**2).mean()) == pytest.approx(0.036, abs=0.015) and abs(dz.mean()) < 0.01


def test_the_plan_construction_refuses_the_published_share():
    """Angle filter: 109217 -> 105806 points, 3.1 %; here without the limit at the nadirs, which is ours."""
    truth = nodes()
    left, right = (seen_on_wrong(truth, centre) for centre in (CENTRES.left, CENTRES.right))
    refused = 1 - correct(left, right, CENTRES, PlanCorrection(nadir=0.0), PIXEL).accepted.mean()
    assert refused == pytest.approx(1 - 105806 / 109217, abs=0.025)


def counted(mean: float, std: float, limit: float) -> Summary:
    """Statistics of a normal law; `limit` stands for the standard error, so that `within_1` is the share below it."""
    dh = mean + std * NORMAL
    return summarised(count(dh, np.full(len(dh), limit), 2.0), 2.0)


@pytest.mark.parametrize(
    ("mean", "std", "beyond"),
    [(-0.295, 0.826, 39.38), (-0.293, 0.853, 40.68), (-0.104, 0.974, 44.39), (-0.101, 0.868, 39.08), (-0.052, 0.884, 39.70)],
)
def test_table_4_14_shares_beyond_one_pixel(mean, std, beyond):
    assert 100 * (1 - counted(mean, std, 0.75).within_1) == pytest.approx(beyond, abs=0.12)


@pytest.mark.parametrize(("mean", "std", "within"), [(-0.248, 0.579, 76.46), (-0.249, 0.576, 76.64), (-0.249, 0.572, 76.91)])
def test_table_4_21_shares_within_one_pixel(mean, std, within):
    found = counted(mean, std, 0.75)
    assert 100 * found.within_1 == pytest.approx(within, abs=0.06)
    assert (found.mean, found.std) == pytest.approx((mean, std), abs=1e-4)
    assert found.nmad == pytest.approx(std, abs=0.01) and found.median == pytest.approx(mean, abs=0.006)


@pytest.mark.parametrize(
    ("std", "shares"), [(0.579, (39.56, 69.99, 99.04)), (0.576, (39.75, 70.24, 99.08)), (0.572, (40.01, 70.58, 99.13))]
)
def test_table_4_22_normal_shares(std, shares):
    for limit, share in zip((0.30, 0.60, 1.50), shares, strict=True):
        assert 100 * counted(0.0, std, limit).within_1 == pytest.approx(share, abs=0.06)


def test_shares_within_three_sigma_are_those_of_three_limits():
    assert counted(0.0, 0.5, 0.5).within_3 == pytest.approx(0.9973, abs=1e-4)


def test_statistics_of_parts_are_those_of_the_whole():
    dh = -0.25 + 0.58 * NORMAL
    parts = added([count(part, np.full(len(part), 0.75), 2.0) for part in np.array_split(dh, 7)])
    whole, merged = counted(-0.25, 0.58, 0.75), summarised(parts, 2.0)
    assert (merged.number, merged.median, merged.nmad) == (whole.number, whole.median, whole.nmad)
    assert (merged.mean, merged.std) == pytest.approx((whole.mean, whole.std))


GRID = MapGrid(west=5000.0, north=6200.0, cell=5.0, rows=240, cols=300)
"""the 1500 x 1200 m of the real pair"""


def real_deformation():
    """Equation 4.20 about the lower left corner: reference minus DSM of +4 to -5 m."""
    x, y = np.meshgrid(*GRID.centres(Window(0, 0, *GRID.shape)))
    return 5 / 1500 * (x - GRID.west) - 5 / 1500 * (y - (GRID.north - 1200))


def test_table_4_20_predicted_statistics_of_the_deformed_surface():
    """Computed from equation 4.20: mean -0.5, std 1.85 and mean absolute 1.5 m for reference minus DSM."""
    dh = -real_deformation()
    found = summarised(count(dh, np.ones_like(dh), 2.0), 2.0)
    assert found.mean == pytest.approx(-0.5, abs=0.01) and found.std == pytest.approx(1.85, abs=0.01)
    assert np.abs(dh).mean() == pytest.approx(1.5, abs=0.08)


def test_table_4_20_the_deformation_is_a_trend():
    """Its gradients are 10/3 m per km; the check reports them as tilt, with a middle of half a metre."""
    dh = -real_deformation()
    trend, plane = fitted_trend(blocks(dh, np.full_like(dh, 0.3), 8), GRID, 8)
    assert trend.east == pytest.approx(-10 / 3, abs=0.01) and trend.north == pytest.approx(10 / 3, abs=0.01)
    assert trend.middle == pytest.approx(-0.5, abs=0.05) and trend.range == pytest.approx(9.0, abs=0.3)
    assert plane.shape == (30, 38)


def test_corrections_are_interpolated_not_heights():
    """sources/measured.md#check: a smooth deformation of a rough surface is recovered from its corrections alone."""
    grid = CorrectionNodes(step=4, pixels_per_cell=1, radius=6.0, move=20.0, window=11.0)
    row, col = (v.ravel() for v in np.mgrid[2:120:4, 2:120:4])
    dh = 16.0 * np.sin(row / 60.0) * np.cos(col / 70.0)
    points = np.column_stack([row, col, dh, np.full(row.size, 0.05)]).astype(float)
    r, c = np.mgrid[:120, :120]
    truth = 16.0 * np.sin(r / 60.0) * np.cos(c / 70.0)
    found = interpolate(points, Window(0, 0, 120, 120), grid).dh
    assert np.abs(found - truth)[8:-8, 8:-8].max() < 0.03
