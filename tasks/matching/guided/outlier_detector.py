"""Removal of spikes from a cloud of points: the published Outlier_detector, repeated until nothing changes.

Every height is compared with the mean and the standard deviation of those in a circle around it; all points are tested, then those
beyond the limit leave together, and the rest is tested again. Points with fewer than two neighbours cannot be tested and stay.

Left as published: where a third of the neighbours is wrong the standard deviation is so large that nothing leaves. With the point
itself among its neighbours a spike among fewer than eleven points can never be found, for (n - 1) / sqrt(n) stays below 3.

Source: Karfis 2009, section 7.3 (sources/epipolar.md#spikes), check 19.
"""

import numpy as np
from scipy.spatial import cKDTree

from orthomill.tasks.matching.guided.guided_settings import OutlierDetector


def without_spikes(points: np.ndarray, radius: float, settings: OutlierDetector) -> np.ndarray:
    """(N,) bool: the points (N, 3) m that stay."""
    kept = np.ones(len(points), bool)
    if len(points) < 2:
        return kept
    # The neighbours are found once; every round leaves out more of them.
    near = cKDTree(points[:, :2]).query_pairs(radius, output_type="ndarray")
    # Sums in an order of their own: that of the pairs depends on how the tree was built.
    first, second = near[np.lexsort((near[:, 1], near[:, 0]))].T
    # About their mean: squares of heights of hundreds of metres would lose the digits of their differences.
    height = points[:, 2] - points[:, 2].mean()
    while True:
        spiky = kept & _beyond(height, kept, first, second, settings)
        if not spiky.any():
            return kept
        kept &= ~spiky


def _beyond(height: np.ndarray, kept: np.ndarray, first: np.ndarray, second: np.ndarray, settings: OutlierDetector) -> np.ndarray:
    both = kept[first] & kept[second]
    one, other, size = first[both], second[both], len(height)
    own = kept * float(settings.includes_point)
    count = own + np.bincount(one, minlength=size) + np.bincount(other, minlength=size)
    total, squares = (
        own * values + np.bincount(one, values[other], size) + np.bincount(other, values[one], size)
        for values in (height, height * height)
    )
    enough = np.maximum(count, 2.0)
    mean = total / enough
    variance = np.maximum(squares / enough - mean * mean, 0.0) * enough / (enough - 1.0)
    # Rounding leaves differences of nanometres on a plane, where the standard deviation is nothing as well.
    return (count >= 2) & (np.abs(height - mean) > settings.sigmas * np.sqrt(variance) + 1e-6)
