"""Scans of a simulated site with known truth; precision against a dense normal matrix by difference quotients."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.orientation.scanned_site import scanned_site
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.registration.joint_registration import register
from orthomill.tasks.adjustment.registration.scan_network import ScannedPoints, ScanNetwork
from orthomill.tasks.adjustment.registration.scan_start import rigid_motion, robust_motion
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector, vector_of_rotation


def registered(site, **changes):
    return register(site.network, replace(site.points, **changes), site.names)


def shifted(site, scan, point, by):
    """The coordinates of the scanned points with one target moved by `by` m."""
    xyz = site.points.xyz.copy()
    xyz[(site.points.scan == scan) & (site.points.point == point)] += by
    return xyz


def target_in(site, scans):
    """A target without control that exactly so many scans show, and these scans."""
    count = np.bincount(site.points.point, minlength=site.network.points)
    point = int(np.flatnonzero((count == scans) & ~site.network.weight.any(axis=1))[0])
    return point, site.points.scan[site.points.point == point].tolist()


@pytest.mark.parametrize("seed", [1, 2])
def test_nine_scans_are_registered_within_their_standard_errors(seed, record_property):
    site = scanned_site(seed)
    found = registered(site)
    assert np.allclose(np.linalg.det(found.state.rotation), 1.0, atol=1e-12)
    for k in range(9):
        turn = vector_of_rotation(found.state.rotation[k] @ site.rotation[k].T)
        error = np.concatenate([found.state.translation[k] - site.translation[k], turn])
        assert (np.abs(error) < 4.0 * np.sqrt(np.diag(found.scan_covariance(k)))).all()
    assert found.sigma0 == pytest.approx(0.004, rel=0.15) and not found.blunders
    rms = np.sqrt((found.residual**2).sum() / found.redundancy_number.sum())
    record_property("found", f"RMS {1000 * rms:.2f} mm of 4, sigma0 {1000 * found.sigma0:.2f} mm")
    assert rms == pytest.approx(0.004, rel=0.15)


def test_exact_scans_give_the_truth():
    site = scanned_site(3, noise=0.0, control_noise=0.0)
    found = registered(site)
    assert np.abs(found.state.translation - site.translation).max() < 1e-6
    assert np.abs(found.state.rotation - site.rotation).max() < 1e-9


def test_residuals_are_along_the_axes_of_the_scan():
    site = scanned_site(4)
    found = registered(site)
    scan, point = site.points.scan[0], site.points.point[0]
    expected = found.state.rotation[scan].T @ (found.state.point[point] - found.state.translation[scan]) - site.points.xyz[0]
    assert found.residual[0] == pytest.approx(expected)


def test_a_target_with_a_wrong_name_is_named_with_its_scan():
    site = scanned_site(5)
    point, scans = target_in(site, 5)
    found = registered(site, xyz=shifted(site, scans[2], point, [0.3, -0.2, 0.1]))
    (blunder,) = found.blunders
    assert (blunder.point, blunder.scans) == (point, (scans[2],))
    assert blunder.size == pytest.approx(np.hypot(0.374, 0.0), rel=0.1)
    assert found.sigma0 == pytest.approx(0.004, rel=0.15)


def test_of_two_scans_that_contradict_each_other_neither_is_believed():
    site = scanned_site(6)
    point, scans = target_in(site, 4)
    rest = ~((site.points.point == point) & np.isin(site.points.scan, scans[2:]))
    site, scans = site._replace(points=site.points.take(rest)), scans[:2]
    found = registered(site, xyz=shifted(site, scans[0], point, [0.0, 0.5, 0.0]))
    (blunder,) = found.blunders
    assert blunder.point == point and sorted(blunder.scans) == sorted(scans)


def test_a_wrong_control_point_is_named():
    site = scanned_site(7)
    control = site.network.control.copy()
    control[3, 2] += 0.05
    found = register(replace(site.network, control=control), site.points, site.names)
    assert [(blunder.point, blunder.scans) for blunder in found.blunders] == [(3, ())]


def test_standard_errors_that_were_stated_too_small_follow_the_residuals():
    site = scanned_site(8)
    found = registered(site, sigma=np.full(len(site.points), 0.001))
    assert found.factor == pytest.approx(4.0, rel=0.15) and not found.blunders


def test_without_control_the_first_scan_defines_the_system():
    site = scanned_site(9, noise=0.001)
    network = replace(site.network, weight=np.zeros_like(site.network.weight))
    found = register(network, site.points, site.names)
    assert np.array_equal(found.state.rotation[0], np.eye(3)) and not found.state.translation[0].any()
    expected = (site.point - site.translation[0]) @ site.rotation[0]
    shown = np.unique(site.points.point)
    assert np.abs(found.state.point - expected)[shown].max() < 0.01
    assert not found.scan_covariance(0).any()


def test_scans_join_the_control_through_each_other():
    # Three control points, each in another scan only: none of the scans can be placed by itself.
    site = scanned_site(10, surveyed=3, targets=60)
    keep = np.ones(len(site.points), bool)
    for point, scan in ((0, 0), (1, 3), (2, 6)):
        rows = site.points.point == point
        keep &= ~rows | (site.points.scan == (scan if (rows & (site.points.scan == scan)).any() else site.points.scan[rows][0]))
    found = register(site.network, site.points.take(keep), site.names)
    assert np.abs(found.state.translation - site.translation).max() < 0.05


def test_a_scan_without_enough_common_targets_is_named():
    site = scanned_site(11)
    others = np.isin(site.points.point, site.points.point[site.points.scan != 4])
    lonely = (site.points.scan == 4) & others
    keep = ~lonely
    keep[np.flatnonzero(lonely)[:2]] = True
    keep[np.flatnonzero(site.points.scan == 4)] &= keep[site.points.scan == 4]
    with pytest.raises(GeometryError, match=r"1 of the scans cannot be joined.*scan_5 \(2\)"):
        register(site.network, site.points.take(keep), site.names)


def test_targets_on_one_line_place_no_scan():
    line = np.outer(np.arange(6.0), [1.0, 2.0, 0.5])
    points = ScannedPoints(np.repeat([0, 1], 6), np.tile(np.arange(6), 2), np.vstack([line, line]), np.full(12, 0.01))
    with pytest.raises(GeometryError, match="not on one line"):
        register(ScanNetwork(2, 6, np.zeros((6, 3)), np.zeros((6, 3))), points, ("a", "b"))


def test_two_scans_with_just_three_common_targets_are_checked_by_nothing():
    corners = np.array([[0.0, 0, 0], [5, 0, 0], [0, 4, 1]])
    points = ScannedPoints(np.repeat([0, 1], 3), np.tile(np.arange(3), 2), np.vstack([corners, corners + 1]), np.full(6, 0.01))
    found = register(ScanNetwork(2, 3, np.zeros((3, 3)), np.zeros((3, 3))), points, ("a", "b"))
    assert found.redundancy == 3, "three distances are measured twice"
    assert found.state.translation[1] == pytest.approx([-1, -1, -1])


def test_precision_equals_that_of_the_dense_normal_matrix():
    site = scanned_site(12, scans=3, targets=14)
    found = registered(site)
    points, state, network = site.points, found.state, found.network
    columns, step = 18 + 3 * network.points, 1e-4

    def rows(k, h):
        change = np.zeros(columns)
        change[k] = h
        moved = state.moved(change[:18].reshape(-1, 6), change[18:].reshape(-1, 3), found.precision.about)
        scanned = moved.misfits(points) / (found.factor * points.sigma[:, None])
        return np.concatenate([scanned.ravel(), (np.sqrt(network.weight) * (moved.point - network.control)).ravel()])

    A = np.stack([(rows(k, step) - rows(k, -step)) / (2 * step) for k in range(columns)], axis=1)
    shown = np.bincount(points.point, minlength=network.points) > 0
    kept = np.concatenate([np.ones(18, bool), np.repeat(shown, 3)])
    Q = np.zeros((columns, columns))
    Q[np.ix_(kept, kept)] = np.linalg.inv((A.T @ A)[np.ix_(kept, kept)])
    assert np.allclose(found.precision.scans, Q[:18, :18], rtol=1e-4, atol=1e-12)
    for i in np.flatnonzero(shown):
        place = slice(18 + 3 * i, 21 + 3 * i)
        assert np.allclose(found.point_covariance[i], Q[place, place], rtol=1e-4, atol=1e-12)
    adjusted = np.einsum("ij,jk,ik->i", A, Q, A)[: 3 * len(points)].reshape(-1, 3)
    assert found.redundancy_number == pytest.approx(3.0 - adjusted.sum(axis=1), rel=1e-4)


def test_the_covariance_of_a_translation_is_that_at_the_origin_of_the_scan():
    site = scanned_site(13)
    found = registered(site)
    turn = np.array([0.0, 0.0, 1e-3])
    lever = found.state.translation[2] - found.precision.about[2]
    moved = rotation_of_vector(turn) @ lever - lever
    own = slice(12, 18)
    Q = np.zeros((54, 54))
    Q[17, 17] = 1.0
    only_turn = replace(found, precision=replace(found.precision, scans=Q))
    assert found.precision.scans[own, own].any()
    assert np.sqrt(np.diag(only_turn.scan_covariance(2))[:3]) == pytest.approx(np.abs(moved) / 1e-3, abs=0.02)


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_a_motion_is_found_among_wrong_points(seed):
    generator = np.random.default_rng(seed)
    own = generator.uniform(-10, 10, (11, 3))
    R, t = rotation_of_vector(generator.normal(0, 2, 3)), generator.uniform(-1e3, 1e3, 3)
    wanted = own @ R.T + t
    wanted[:4] += generator.uniform(1, 9, (4, 3))
    found, shift = robust_motion(own, wanted)
    assert np.allclose(found, R, atol=1e-9) and np.allclose(shift, t, atol=1e-6)


def test_points_in_a_plane_give_no_reflection():
    own = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    R, _ = rigid_motion(own, own[:, [1, 0, 2]])
    assert np.linalg.det(R) == pytest.approx(1.0)
