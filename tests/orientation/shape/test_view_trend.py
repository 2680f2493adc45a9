"""Photographs that turn with a bent block diverge from their attitudes; noise and a common mounting error do not."""

import numpy as np
import pytest

from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.shape.view_trend import view_trend


def flight(seed=0, noise_deg=0.3, headings=True):
    """Places (24, 2) and rotations (24, 3, 3) of photographs that look down, in strips there and back."""
    rng = np.random.default_rng(seed)
    xy = np.array([(10.0 * i, 20.0 * s) for s in range(3) for i in (range(8) if s % 2 == 0 else range(7, -1, -1))])
    kappa = np.repeat([90.0, -90.0, 90.0], 8) if headings else np.zeros(24)
    angles = np.column_stack([rng.normal(0, noise_deg, (24, 2)), kappa])
    return xy, np.array([rotation_matrix(*np.radians(row)) for row in angles])


def bent(xy, rotation, sag):
    """The rotations of photographs that turn with a sheet whose ends are `sag` m higher than its middle."""
    away = xy - xy.mean(axis=0)
    slope = 2.0 * sag * away / (np.linalg.norm(away, axis=1).max() ** 2)
    # Where heights grow with x, the normal leans back: a rotation about y by minus the slope, and one about x by plus it.
    turns = [rotation_matrix(slope[i, 1], -slope[i, 0], 0.0).T for i in range(len(xy))]
    return np.array([r @ t.T for r, t in zip(rotation, turns, strict=True)])


@pytest.mark.parametrize("sag", [-0.8, 0.5])
def test_the_divergence_gives_the_bend(sag):
    xy, truth = flight()
    up = truth[:, :, 2]
    found = view_trend(xy, bent(xy, truth, sag), up + 0.0)
    assert found.bend == pytest.approx(sag, rel=0.05) and abs(found.ratio) > 5
    assert np.sign(found.degrees) == np.sign(sag)


def test_errors_of_the_gimbal_and_of_its_mounting_do_not_diverge():
    ratios = []
    for seed in range(100):
        xy, truth = flight(seed)
        wobble, mounting = np.random.default_rng(seed + 500).normal(0, np.radians(0.5), (24, 2)), np.radians((2.0, -1.0))
        tilts = [rotation_matrix(*(w + mounting), 0.0) for w in wobble]
        up = np.array([t @ r[:, 2] for t, r in zip(tilts, truth, strict=True)])
        ratios.append(view_trend(xy, truth, up).ratio)
    assert np.abs(ratios).max() < 5 and np.std(ratios) == pytest.approx(1.0, abs=0.35)


def test_too_few_attitudes_show_nothing():
    xy, truth = flight()
    assert view_trend(xy[:7], truth[:7], truth[:7, :, 2]) is None
