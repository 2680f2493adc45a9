"""The published way to one radiometry: the histograms of the photographs are made alike (M19), on the ground that they share.

Of every photograph and channel the quantiles of its grey values at shared places become the quantiles of the mean of all
photographs at the same places: the same ground on both sides, whatever else the photographs show. Between the quantiles the curve
is linear, beyond them its distance stays. It follows curves that a gain and an offset cannot (two cameras, developed files); it
takes the contrast of blurred photographs for exposure, and a vignetting it leaves.

Source: Petsa et al. 2007 (sources/blending.md, M19); method and reference are not stated there.
"""

import numpy as np

from orthomill.tasks.colouring.balance.photo_radiometry import GreyCurve, PhotoRadiometry, Radiometry, corrected
from orthomill.tasks.colouring.balance.shared_ground import Samples, pair_differences, usable_samples

KNOTS = 17
"""quantiles of a curve"""
LEAST = 100
"""samples that a curve needs: with fewer a photograph keeps its grey values"""


def matched_block(names: tuple[str, ...], samples: Samples, white: float) -> Radiometry:
    """The radiometry of photographs `names` whose histograms are made alike; `white` as in `balance_block`."""
    samples = usable_samples(samples, 0.0, white)
    identity = Radiometry(photos=tuple(PhotoRadiometry(photo=name) for name in names), white=white)
    if not len(samples):
        return identity
    _, point = np.unique(samples.point, return_inverse=True)
    grey, count = samples.grey, np.bincount(point)
    mean = np.stack([np.bincount(point, grey[:, band]) / count for band in range(3)], axis=1)[point]
    photos, after = [], grey.copy()
    for number, name in enumerate(names):
        mine = samples.photo == number
        curves = tuple(_curve(grey[mine, band], mean[mine, band]) for band in range(3)) if mine.sum() >= LEAST else ()
        photos.append(PhotoRadiometry(photo=name, curves=curves, samples=int(mine.sum())))
        after[mine] = corrected(grey[mine], samples.r2[mine], photos[-1])
    unit = white / 255.0
    differences = pair_differences(samples.point, after / unit)
    return Radiometry(
        photos=tuple(photos),
        white=white,
        samples=len(samples),
        points=int(point.max()) + 1,
        difference_before=float(pair_differences(samples.point, grey / unit).mean()),
        difference_after=float(differences.mean()),
        difference_median_after=float(np.median(differences)),
    )


def _curve(own: np.ndarray, wanted: np.ndarray) -> GreyCurve:
    """The curve from the quantiles of `own` to those of `wanted` (N,)."""
    shares = np.linspace(0.0, 1.0, KNOTS)[1:-1]
    start, end = np.quantile(own, shares), np.quantile(wanted, shares)
    # Equal quantiles of a flat histogram would make a step.
    start = np.maximum.accumulate(start + 1e-6 * np.arange(len(start)))
    return GreyCurve(start=tuple(map(float, start)), end=tuple(map(float, end)))
