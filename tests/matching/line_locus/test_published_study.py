"""The published study of vertical line locus (sources/line_locus.md): its grid, and tables whose counts are those of the grid."""

import numpy as np
import pytest

from benchmarks.vll.line_locus_scene import height, nodes
from benchmarks.vll.line_locus_study import CHECKS, histogram, judged, limit_of
from orthomill.tasks.matching.line_locus.line_locus import FoundHeights


@pytest.fixture(scope="module")
def found() -> FoundHeights:
    """Heights 1 m too high whose correlations are anything; nothing is known of one row."""
    truth = np.asarray(height(*np.meshgrid(*nodes())))
    heights = FoundHeights.empty(truth.shape)
    heights.height[:] = truth + 1.0
    heights.correlation[:] = np.random.default_rng(2).uniform(-1, 1, truth.shape)
    heights.correlation[7] = np.nan
    return heights


def test_the_grid_is_the_published_one(found):
    """B-05: 5959 nodes, and every fifth in both directions is one of 252 checks on 50 m."""
    x, y = nodes()
    assert len(x) * len(y) == 5959 and len(x[::5]) * len(y[::5]) == 252
    assert np.allclose(np.diff(x[::5]), 50.0) and np.ptp(height(*np.meshgrid(x, y))) == pytest.approx(100.0, abs=15.0)
    assert judged(found, 0.0).all == 5959 and judged(found, 0.0, every=5).all == 252


def test_a_threshold_counts_what_passes_it_and_its_errors(found):
    """B-11: number, share, RMSE and greatest error."""
    strict, loose = judged(found, 0.6), judged(found, limit_of(25))
    assert strict.accepted == (np.abs(found.correlation) > 0.6).sum() < loose.accepted < 5959
    assert strict.rmse == pytest.approx(1.0, abs=1e-4) and strict.most == pytest.approx(1.0, abs=1e-4)
    assert strict.share == pytest.approx(100 * strict.accepted / 5959)


def test_the_histogram_splits_all_nodes_by_their_correlation(found):
    """B-11: the bars of all three groups together are the grid."""
    rows = [[int(cell) for cell in line.split("|")[2:5]] for line in histogram(found, 25)[2:]]
    counts = np.array(rows)
    rho = np.abs(np.nan_to_num(found.correlation))
    assert counts.sum() == 5959 and counts.sum(axis=0)[0] == (rho >= 0.6).sum()
    assert (counts.sum(axis=1) > 0).sum() <= 2, "all errors are 1 m, the edge of two classes"


def test_every_acceptance_check_has_its_place():
    assert list(CHECKS) == [f"B-{number:02d}" for number in range(1, 13)]
