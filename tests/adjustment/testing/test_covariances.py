"""Covariances: any part of them, what considered parameters add, and points that took no part."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import small_network

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Rays
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections, point_precision_alone
from orthomill.tasks.adjustment.testing.covariances import (
    covariance_of,
    distances_elsewhere,
    joint_elsewhere,
    points_and_rays,
    points_elsewhere,
    with_considered,
)


@pytest.fixture(scope="module")
def chain():
    """A chain of photographs, each of which shares points with its neighbours only."""
    network, state, rays = small_network(photos=10, points=60, interior_free=())
    network = replace(network, shift=NOT_SHIFTED)
    near = rays.photo // 2 == np.minimum(rays.point // 13, 4)
    linked = (rays.photo // 2 == np.minimum(rays.point // 13, 4) + 1) & (rays.point % 13 < 6)
    rays = rays.take(near | linked)
    linear = linearised(network, state, rays)
    return network, state, rays, linear, covariance_of(network, state, linear)


def test_any_joint_part_is_that_of_the_whole(chain):
    *_, cofactor = chain
    whole = cofactor.times(np.eye(len(cofactor)))
    unit = np.sqrt(np.diag(whole))
    assert np.allclose(whole / np.outer(unit, unit), (whole / np.outer(unit, unit)).T, atol=1e-9)
    for columns in (np.arange(6), np.array([0, 3, 58, 57]), np.array([59, 1])):
        expected = whole[np.ix_(columns, columns)]
        assert np.allclose(cofactor.joint(columns), expected, atol=1e-9 * np.abs(expected).max())
    assert cofactor.variances == pytest.approx(np.diag(whole), rel=1e-8)


def test_photographs_without_common_points_have_no_block_but_a_covariance(chain):
    *_, cofactor = chain
    columns = np.array([0, 54])
    assert not np.isfinite(cofactor.blocks.pieces(columns)).all()
    assert np.isfinite(cofactor.joint(columns)).all() and cofactor.joint(columns)[0, 1] != 0.0


def test_an_absent_unknown_has_no_covariance(chain):
    *_, cofactor = chain
    joint = cofactor.joint(np.array([0, -1, 54]))
    assert not joint[1].any() and not joint[:, 1].any() and joint[0, 0] > 0


def test_new_points_between_any_photographs_have_the_precision_of_old_ones(chain):
    network, _, _, linear, cofactor = chain
    points, _ = points_and_rays(network, linear, cofactor)
    same = points_elsewhere(linear, cofactor)
    assert np.allclose(same, points, rtol=1e-9, atol=1e-12)


def test_distances_know_that_errors_of_the_orientation_move_neighbours_alike(chain):
    network, state, _, linear, cofactor = chain
    unknown = np.flatnonzero(~network.point_weight.any(axis=1))
    ends = unknown[[[0, 1], [2, -1]]]
    at_rest = point_corrections(linear, np.zeros(len(cofactor)))
    moved = np.stack([point_corrections(linear, unit) - at_rest for unit in np.eye(len(cofactor))], axis=2)
    alone = point_precision_alone(linear, cofactor.blocks.pattern.start)
    whole = cofactor.times(np.eye(len(cofactor)))
    for (i, j), variance in zip(ends, distances_elsewhere(linear, cofactor, state.point, ends), strict=True):
        towards = (state.point[j] - state.point[i]) / np.linalg.norm(state.point[j] - state.point[i])
        apart = moved[j] - moved[i]
        expected = apart @ whole @ apart.T + alone[i] + alone[j]
        assert variance == pytest.approx(towards @ expected @ towards, rel=1e-8)


def test_points_together_have_their_own_covariances_and_those_of_their_differences(chain):
    """More columns than are made at a time."""
    network, state, _, linear, cofactor = chain
    unknown = np.flatnonzero(~network.point_weight.any(axis=1))[:25]
    joint = joint_elsewhere(linear, cofactor, unknown).reshape(len(unknown), 3, len(unknown), 3)
    own = points_elsewhere(linear, cofactor)[unknown]
    assert np.allclose(np.einsum("ijik->ijk", joint), own, rtol=1e-8, atol=1e-12 * np.abs(own).max())
    ends = np.array([[0, 1], [3, 24]])
    for (i, j), variance in zip(ends, distances_elsewhere(linear, cofactor, state.point, unknown[ends]), strict=True):
        towards = state.point[unknown[j]] - state.point[unknown[i]]
        towards /= np.linalg.norm(towards)
        apart = joint[i, :, i] + joint[j, :, j] - joint[i, :, j] - joint[j, :, i]
        assert variance == pytest.approx(towards @ apart @ towards, rel=1e-8)


def test_a_point_of_distant_photographs_is_less_certain_than_rays_alone_say(chain):
    network, state, _, _, cofactor = chain
    pair = Rays(np.zeros(2, np.int32), np.array([0, 9], np.int32), np.zeros((2, 2)), np.full(2, 0.3))
    single = replace(network, point=state.point[:1], point_weight=np.zeros((1, 3)))
    own = linearised(single, replace(state, point=state.point[:1]), pair)
    with_photographs = points_elsewhere(own, cofactor)[0]
    sharper = points_elsewhere(own._replace(weight=1e6 * own.weight), cofactor)[0]
    assert (np.linalg.eigvalsh(with_photographs - sharper) > 0).all() and (np.linalg.eigvalsh(sharper) > 0).all()


def test_computed_coordinates_are_more_precise_than_observed_ones(chain):
    network, _, rays, linear, cofactor = chain
    _, adjusted = points_and_rays(network, linear, cofactor)
    assert (adjusted > 0).all() and (adjusted <= (rays.sigma**2)[:, None] * (1 + 1e-6)).all()


def considered_network(sigma):
    network, state, rays = small_network(seed=4, photos=6, points=40, interior_free=(0, 3))
    considered, weight = np.zeros((1, 8), bool), np.zeros((1, 8, 8))
    considered[0, 0] = True
    weight[0, 0, 0], weight[0, 3, 3] = 1 / sigma**2, 1e4
    network = replace(network, interior=replace(network.interior, considered=considered, weight=weight))
    linear = linearised(network, state, rays)
    return network, linear, covariance_of(network, state, linear)


def test_the_contribution_of_a_considered_parameter_grows_with_its_variance():
    added = []
    for sigma in (1.0, 3.0):
        network, linear, cofactor = considered_network(sigma)
        total = with_considered(network, linear, cofactor)
        added.append(total.variances - cofactor.variances)
        assert total.variances[network.interior_columns[0, 0]] == pytest.approx(sigma**2)
    assert added[1] == pytest.approx(9.0 * added[0], rel=1e-6) and (added[0] >= -1e-15).all()


def test_without_considered_parameters_the_covariance_is_the_same_object(chain):
    network, _, _, linear, cofactor = chain
    assert with_considered(network, linear, cofactor) is cofactor


def test_points_inherit_the_uncertainty_of_considered_parameters():
    network, linear, cofactor = considered_network(5.0)
    total = with_considered(network, linear, cofactor)
    before, after = (points_and_rays(network, linear, each)[0] for each in (cofactor, total))
    assert (np.linalg.eigvalsh(after - before) > -1e-9).all()
    assert (after[10:, 2, 2] > before[10:, 2, 2]).all(), "c changes heights"


@pytest.mark.parametrize("lacking", ["datum", "rays of a photograph"])
def test_what_is_not_determined_is_refused(lacking):
    network, state, rays = small_network(interior_free=())
    if lacking == "datum":
        nothing = np.zeros_like(network.point_weight)
        network = replace(network, point_weight=nothing, centre_weight=np.zeros((4, 3)), shift=NOT_SHIFTED)
    else:
        rays = rays.take((rays.photo != 2) | (rays.point == 7))
    with pytest.raises(GeometryError, match="not determined"):
        covariance_of(network, state, linearised(network, state, rays))
