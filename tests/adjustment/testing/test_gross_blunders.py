"""Gross blunders on a robust solution, found from the rays alone."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import more_control, small_network, surveyed_noise

from orthomill.tasks.adjustment.model.network import Distances
from orthomill.tasks.adjustment.model.surveyed_observations import SurveyedKind
from orthomill.tasks.adjustment.testing.gross_blunders import gross_blunder, lengths_of_rays, surveyed_factors, well_pointed

ENDS = np.array([[4, 30], [5, 31], [6, 32], [7, 33]])


@pytest.fixture(scope="module")
def block():
    network, state, rays = small_network(seed=2, photos=6, points=60, noise=1.0)
    return more_control(network, 10), state, rays


def with_distances(network, state, wrong=0.0):
    length = np.linalg.norm(state.point[ENDS[:, 0]] - state.point[ENDS[:, 1]], axis=1)
    length[1] += wrong
    named = np.unique(np.append(network.named, ENDS))
    return replace(network, kept=np.unique(ENDS), distances=Distances(ENDS, length, np.full(4, 1 / 0.01**2)), named=named)


def test_a_good_block_has_none(block):
    assert gross_blunder(*block, 6.0) is None


def test_the_worse_of_two_is_found_first(block):
    network, state, rays = block
    point, centre = network.point.copy(), network.centre.copy()
    point[3] += [0.0, 2.0, 0.0]
    centre[1] += [1.5, 0.0, 0.0]
    found = gross_blunder(replace(network, point=point, centre=centre), state, rays, 6.0)
    assert found is not None and (found.kind, found.number) == (SurveyedKind.CONTROL, 3)
    found = gross_blunder(replace(network, centre=centre), state, rays, 6.0)
    assert found is not None and (found.kind, found.number) == (SurveyedKind.POSITION, 1)
    assert found.misfit == pytest.approx(15.0)


def test_coordinates_are_compared_with_the_rays_even_if_the_solution_follows_them(block):
    network, state, rays = block
    point = network.point.copy()
    point[3] += [0.0, 2.0, 0.0]
    dragged = state.point.copy()
    dragged[3] = point[3]
    found = gross_blunder(replace(network, point=point), replace(state, point=dragged), rays, 6.0)
    assert found is not None and (found.kind, found.number) == (SurveyedKind.CONTROL, 3)


def test_points_whose_rays_meet_are_well_pointed_whatever_their_coordinates(block):
    network, state, rays = block
    point, xy = network.point.copy(), rays.xy.copy()
    point[3] += [0.0, 2.0, 0.0]
    xy[np.flatnonzero(rays.point == 5)[0]] += 40.0
    two = np.arange(len(rays)) >= 0
    two[np.flatnonzero(rays.point == 7)[2:]] = False
    found = well_pointed(replace(network, point=point), state, replace(rays, xy=xy).take(two), 6.0)
    assert np.flatnonzero(~found[:10]).tolist() == [5, 7], "one ray is wrong, or two may meet by chance"
    assert not found[10:].any(), "tie points are nobody's pointings"


def test_a_wrong_pointing_does_not_blame_the_coordinates(block):
    network, state, rays = block
    xy = rays.xy.copy()
    xy[np.flatnonzero(rays.point == 3)[0]] += 40.0
    assert gross_blunder(network, state, replace(rays, xy=xy), 6.0) is None


def test_a_control_point_with_one_ray_is_not_judged(block):
    network, state, rays = block
    point = network.point.copy()
    point[3] += 5.0
    single = rays.take((rays.point != 3) | (rays.photo == 0))
    assert gross_blunder(replace(network, point=point), state, single, 6.0) is None


@pytest.mark.parametrize(("wrong", "number"), [(0.0, None), (3.0, 1), (-3.0, 1)])
def test_a_wrong_distance_is_found(block, wrong, number):
    network, state, rays = block
    found = gross_blunder(with_distances(network, state, wrong), state, rays, 6.0)
    assert (found and (found.kind, found.number)) == (number and (SurveyedKind.DISTANCE, number))


def test_lengths_of_rays_come_with_the_precision_of_their_ends(block):
    network, state, rays = block
    network = with_distances(network, state)
    exact = replace(rays, xy=rays.xy)
    length, sigma = lengths_of_rays(network, state, exact, 6.0)
    assert np.abs(length - network.distances.length).max() < 5 * sigma.max() and (sigma > 0).all()
    assert (np.abs(length - network.distances.length) / sigma).max() < 4.0
    double = replace(exact, sigma=2 * exact.sigma)
    assert lengths_of_rays(network, state, double, 6.0)[1] == pytest.approx(2 * sigma, rel=1e-3)


def test_lengths_between_points_whose_rays_do_not_intersect_are_unknown(block):
    network, state, rays = block
    network = with_distances(network, state)
    xy = rays.xy.copy()
    xy[np.flatnonzero(rays.point == ENDS[2, 0])[:2]] += [[50.0, 0.0], [-50.0, 30.0]]
    length, sigma = lengths_of_rays(network, state, replace(rays, xy=xy), 6.0)
    assert list(np.isnan(length)) == [False, False, True, False] == list(np.isnan(sigma))


def test_standard_errors_that_all_control_contradicts_are_enlarged_and_chance_is_not():
    network, state, rays = small_network(6, photos=6, points=60, noise=0.3)
    network = more_control(network, 12)
    rng = np.random.default_rng(4)
    for size, enlarged in ((1.0, False), (40.0, True)):
        noisy = surveyed_noise(network, rng, control=size)
        factors = surveyed_factors(noisy, state, rays, 6.0)
        assert factors.position == (1.0,) and factors.image == 1.0
        assert (factors.control == pytest.approx(size, rel=0.5)) if enlarged else (factors.control == 1.0)
