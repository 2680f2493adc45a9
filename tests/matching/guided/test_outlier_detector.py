"""The published removal of spikes (check 19 of sources/epipolar.md)."""

import numpy as np
import pytest

from orthomill.tasks.matching.guided.guided_settings import OutlierDetector
from orthomill.tasks.matching.guided.outlier_detector import without_spikes


def cloud(seed: int = 1, count: int = 900, noise: float = 0.3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 60, (2, count))
    return np.column_stack([x, y, 200.0 + 0.05 * x + rng.normal(0, noise, count)])


def kept(points: np.ndarray, radius: float = 5.0, **asked) -> np.ndarray:
    return without_spikes(points, radius, OutlierDetector(**asked))


def test_isolated_spikes_are_removed_and_a_second_run_removes_nothing():
    points = cloud()
    spikes = np.arange(0, 900, 60)
    points[spikes, 2] += 20 * 0.3 * np.where(np.arange(len(spikes)) % 2, 1, -1)
    stay = kept(points)
    assert not stay[spikes].any() and stay.mean() > 0.95
    assert kept(points[stay]).all()


def test_it_is_repeated_because_a_great_spike_hides_a_smaller_one():
    points = cloud(2)
    here = np.argmin(np.hypot(points[:, 0] - 30, points[:, 1] - 30))
    beside = np.argsort(np.hypot(*(points[:, :2] - points[here, :2]).T))[1]
    points[here, 2] += 400.0
    points[beside, 2] += 8.0
    near = np.hypot(*(points[:, :2] - points[beside, :2]).T) < 5.0
    assert abs(points[beside, 2] - points[near, 2].mean()) < 3 * points[near, 2].std(), "not found while the great one is there"
    assert not kept(points)[[here, beside]].any()


def test_a_plane_stays_and_so_do_lonely_points():
    x, y = (axis.ravel() for axis in np.mgrid[:40:2.0, :40:2.0])
    assert kept(np.column_stack([x, y, 900.0 + 0.3 * x - 0.1 * y])).all()
    assert kept(np.array([[0, 0, 1.0], [100, 0, 99.0], [101, 0, 0.0]])).all()
    assert kept(np.empty((0, 3))).shape == (0,)


def test_a_cluster_of_a_third_stays_as_published():
    points = cloud(3, 600, 0.2)
    third = np.hypot(points[:, 0] - 30, points[:, 1] - 30) < 3.0
    points[third, 2] += 8.0
    assert kept(points, 5.0)[third].mean() > 0.9


def test_with_the_point_among_its_neighbours_a_spike_among_ten_is_never_found():
    ring = np.column_stack([np.cos(np.arange(9)), np.sin(np.arange(9)), 0.1 * np.sin(3.0 * np.arange(9))])
    points = np.vstack([ring, [0.0, 0.0, 1000.0]])
    assert kept(points, includes_point=True).all()
    assert not kept(points, includes_point=False)[-1]


@pytest.mark.parametrize(("asked", "reach"), [({}, 12.0), ({"radius": 7.0}, 7.0)])
def test_the_radius_follows_from_the_pixel_unless_it_is_given(asked, reach):
    assert OutlierDetector(**asked).reach(0.5) == reach


def test_fewer_sigmas_remove_more():
    assert kept(cloud(), sigmas=2.0).sum() < kept(cloud(), sigmas=3.0).sum()
