"""Histograms of photographs made alike on the ground that they share (M19 of sources/blending.md)."""

import numpy as np
import pytest

from orthomill.tasks.colouring.balance.balancing import balanced
from orthomill.tasks.colouring.balance.histogram_matching import LEAST, matched_block
from orthomill.tasks.colouring.balance.photo_radiometry import GreyCurve, PhotoRadiometry, corrected
from orthomill.tasks.colouring.balance.shared_ground import Samples


def block_of(curves, points: int = 4000) -> tuple[Samples, np.ndarray]:
    """Every place in all photographs, each with its own curve from the ground's brightness to its grey values."""
    ground = np.random.default_rng(3).uniform(40, 200, (points, 3))
    rows = [curve(ground) for curve in curves]
    grey = np.stack(rows, axis=1).reshape(-1, 3).astype(np.float32)
    photo, point = np.tile(np.arange(len(curves)), points).astype(np.int32), np.repeat(np.arange(points), len(curves))
    return Samples(point, photo, np.zeros(len(grey), np.float32), *grey.T), ground


def bent(g):
    return 20 + 200 * (g / 240) ** 1.5


def test_curves_that_no_gain_explains_become_alike():
    samples, ground = block_of([lambda g: g, bent, lambda g: 0.9 * g + 5])
    matched = matched_block(("a", "b", "c"), samples, 255.0)
    assert matched.difference_before > 8 * matched.difference_after
    straight = balanced((samples,), ("a", "b", "c"), False, "block", False)
    assert matched.difference_after < 0.7 * straight.difference_after
    zero = np.zeros(len(ground), np.float32)
    ours, theirs = corrected(ground, zero, matched.of("a")), corrected(bent(ground), zero, matched.of("b"))
    assert np.percentile(np.abs(ours - theirs), 95) < 3.0
    assert np.abs(ours.mean() - np.mean([ground, bent(ground), 0.9 * ground + 5])) < 1.0


def test_the_way_is_chosen_by_name_and_few_samples_change_nothing():
    samples, _ = block_of([lambda g: g, bent])
    assert balanced((samples,), ("a", "b"), False, "histogram", False).of("b").curves
    few = samples.take(samples.point < LEAST // 2)
    assert matched_block(("a", "b"), few, 255.0).of("a").curves == ()
    nothing = matched_block(("a", "b"), samples.take(np.zeros(len(samples), bool)), 255.0)
    assert nothing.samples == 0 and nothing.white == 255.0


def test_beyond_its_ends_a_curve_keeps_its_distance():
    curve = GreyCurve(start=(50.0, 100.0), end=(60.0, 130.0))
    photo = PhotoRadiometry(photo="a", curves=(curve,) * 3)
    grey = np.array([[10.0, 75.0, 200.0]], np.float32)
    assert corrected(grey, np.zeros(1, np.float32), photo)[0] == pytest.approx([20.0, 95.0, 230.0])
