"""Variance components: known noise is found again, group by group; surveyed groups are only ever enlarged."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import more_control, small_network, surveyed_noise

from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.network import Distances
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.testing.adjustment_result import AS_STATED, Factors, ObservationKind
from orthomill.tasks.adjustment.testing.solution_precision import precise_solution
from orthomill.tasks.adjustment.testing.variance_components import (
    converged,
    distance_variances,
    enlarged,
    estimated_factors,
    image_factor_without,
)

ENDS = np.array([[20, 50], [21, 51], [22, 52]])


def block(seed=0, image=1.0, position=1.0, control=1.0):
    """A block whose observations have these multiples of their stated standard errors."""
    network, state, rays = small_network(seed=seed, photos=10, points=80, noise=image)
    network = surveyed_noise(more_control(network, 14), np.random.default_rng(seed), position, control)
    return network, state, rays


def solved(network, state, rays, factors=AS_STATED):
    state, _ = minimise(network, state, rays)
    return precise_solution(network, state, rays, np.ones(len(rays), bool), factors)


@pytest.mark.parametrize("image", [0.5, 1.0, 3.0])
def test_the_factor_of_image_measurements_is_that_of_the_noise(image):
    factors = adjust(*block(1, image)).factors
    assert factors.image == pytest.approx(image, rel=0.06)


@pytest.mark.parametrize("group", ["position", "control"])
def test_a_group_that_is_worse_than_stated_is_enlarged(group):
    factors = [adjust(*block(seed, **{group: 4.0})).factors for seed in range(3)]
    assert np.mean([np.max(getattr(f, group)) for f in factors]) == pytest.approx(4.0, rel=0.3)
    other = "control" if group == "position" else "position"
    assert all(np.max(getattr(f, other)) < 1.6 for f in factors)


def test_a_group_that_is_better_than_stated_keeps_its_standard_errors():
    factors = adjust(*block(2, position=0.2, control=0.2)).factors
    assert factors.position == (1.0,) and factors.control == 1.0


def test_groups_are_counted_and_their_redundancies_sum_to_that_of_the_block():
    result = solved(*block(3))
    _, groups = estimated_factors(result)
    assert [group.name for group in groups] == list(ObservationKind)[:4]
    count = {group.name: group.count for group in groups}
    assert count[ObservationKind.POSITIONS] == 30 and count[ObservationKind.CONTROL] == 42
    assert count[ObservationKind.TIES] + count[ObservationKind.POINTINGS] == 2 * len(result.rays)
    # The interior orientation is weighted, too: three observations, which are no group of their own.
    total = sum(group.redundancy for group in groups)
    assert result.redundancy - 3.001 < total <= result.redundancy + 0.01


def test_factors_multiply_those_of_the_last_solution():
    network, state, rays = block(4, image=2.0)
    once, _ = estimated_factors(solved(network, state, rays))
    scaled = replace(rays, sigma=once.image * rays.sigma)
    twice, _ = estimated_factors(solved(network, state, scaled, replace(AS_STATED, image=once.image)))
    assert once.image == pytest.approx(2.0, rel=0.05) and twice.image == pytest.approx(once.image, rel=0.02)


@pytest.mark.parametrize(
    ("square", "redundancy", "expected"),
    [(40.0, 10.0, 2.0), (10.0, 10.0, 1.0), (20.0, 10.0, 1.0), (2.0, 10.0, 1.0), (900.0, 2.9, 1.0)],
)
def test_surveyed_groups_are_enlarged_only_beyond_chance(square, redundancy, expected):
    assert enlarged(1.0, square, redundancy) == pytest.approx(expected)


def test_an_enlarged_group_may_shrink_again_but_not_below_its_statement():
    assert enlarged(4.0, 2.5, 10.0) == pytest.approx(2.0)
    assert enlarged(4.0, 0.1, 10.0) == 1.0
    assert enlarged(4.0, 0.1, 2.0) == 4.0, "without redundancy nothing is known"


@pytest.mark.parametrize(("change", "expected"), [(1.0, True), (1.009, True), (1.02, False), (0.98, False)])
def test_factors_have_converged_within_one_per_cent(change, expected):
    old = Factors(image=0.3, pointing=1.0, position=(5.0,), control=1.0, distance=1.0)
    assert converged(replace(old, position=(5.0 * change,)), old) == expected


def test_variances_of_adjusted_distances_are_below_the_measured_ones():
    network, state, rays = block(5)
    length = np.linalg.norm(state.point[ENDS[:, 0]] - state.point[ENDS[:, 1]], axis=1)
    network = replace(network, kept=np.unique(ENDS), distances=Distances(ENDS, length, np.array([1e2, 1e4, 1e8])))
    variance = distance_variances(solved(network, state, rays))
    assert (variance * network.distances.weight <= 1.0).all() and (variance > 0).all()
    assert variance[2] * 1e8 == pytest.approx(1.0, rel=1e-2), "a very precise distance stays as precise"
    none = replace(network, distances=replace(network.distances, weight=np.zeros(3)))
    assert (distance_variances(solved(none, state, rays)) >= variance).all()


def test_the_factor_without_a_wrong_ray_is_nearly_that_of_the_solution_without_it():
    network, state, rays = block(3)
    xy = rays.xy.copy()
    xy[[120, 400]] += 9.0
    wrong = replace(rays, xy=xy)
    before = solved(network, state, wrong)
    lost = np.isin(np.arange(len(rays)), [120, 400])
    used, factors = ~lost, estimated_factors(before)[0]
    state, _ = minimise(network, before.state, wrong.take(used))
    after = estimated_factors(precise_solution(network, state, wrong, used, AS_STATED))[0]
    assert factors.image > 1.1 * after.image
    # A linear prediction: the blunders have bent the photographs as well, which the solution without them mends.
    assert image_factor_without(before, lost) - after.image < 0.25 * (factors.image - after.image)
    assert image_factor_without(before, ~used & ~lost) == pytest.approx(factors.image)


def test_each_group_of_positions_has_a_factor_of_its_own():
    network, state, rays = small_network(seed=6, photos=16, points=80, noise=1.0)
    network = more_control(network, 14)
    good, bad = (surveyed_noise(network, np.random.default_rng(6), times).centre for times in (1.0, 12.0))
    second = np.arange(16) % 2 == 1
    network = replace(network, centre=np.where(second[:, None], bad, good))
    apart = adjust(replace(network, gnss_group=second.astype(np.int64)), state, rays)
    first, other = apart.factors.position
    assert first == 1.0 and 7 < other < 17, "the receiver that errs is weighed down, and only that"
    assert apart.blunders == (), "none of its positions is a blunder beside the others of its own"
    counts = [(group.count, group.part) for group in apart.groups if group.name == ObservationKind.POSITIONS]
    assert counts == [(24, 0), (24, 1)]
    together = adjust(network, state, rays)
    assert together.factors.position[0] > 4.0 or together.blunders, "one factor for all blames both"


def test_a_group_without_positions_is_as_stated():
    network, state, rays = small_network(seed=7, photos=8, points=60, noise=1.0)
    weight = network.centre_weight.copy()
    weight[4:] = 0.0
    network = replace(more_control(network, 14), centre_weight=weight, gnss_group=np.arange(8) // 4)
    result = adjust(network, state, rays)
    assert result.factors.position[1] == 1.0
    assert [group.part for group in result.groups if group.name == ObservationKind.POSITIONS] == [0]
