"""The order of unknowns: every column has one owner, whatever a block knows."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_network import small_network

from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Distances, Interior, Rays, common_shift, ray_columns

CHOICES = st.fixed_dictionaries(
    {
        "free": st.lists(st.integers(0, 7), max_size=8, unique=True),
        "shift": st.booleans(),
        "lever": st.integers(0, 2),
        "kept": st.lists(st.integers(0, 29), max_size=5, unique=True),
    }
)


def network_of(free, shift, lever, kept):
    network, state, rays = small_network(interior_free=tuple(free))
    shifted = common_shift(network.photos) if shift else NOT_SHIFTED
    network = replace(network, shift=shifted, kept=np.array(sorted(kept), np.int64), lever_weight=np.full(3, 100.0 * lever))
    receiver = np.arange(network.photos) % max(lever, 1)
    network = replace(network, lever=np.zeros((max(lever, 1), 3)), receiver=receiver)
    return network, state, rays


@settings(max_examples=60, deadline=None)
@given(choice=CHOICES)
def test_every_unknown_has_one_column(choice):
    network, _, _ = network_of(**choice)
    exterior = np.arange(6 * network.photos)
    parts = [network.interior_columns.ravel(), network.shift_columns, network.lever_columns.ravel(), network.kept_columns.ravel()]
    columns = np.concatenate([exterior, *(part[part >= 0] for part in parts)])
    assert sorted(columns) == list(range(network.unknowns))


@settings(max_examples=60, deadline=None)
@given(choice=CHOICES)
def test_groups_are_the_unknowns_that_occur_together(choice):
    network, _, _ = network_of(**choice)
    start = network.group_start
    assert start[0] == 0 and start[-1] == network.unknowns and (np.diff(start) > 0).all()
    expected = [6] * network.photos + [len(choice["free"])] * bool(choice["free"])
    expected += [3 * (choice["shift"] + choice["lever"])] * bool(choice["shift"] or choice["lever"]) + [3] * len(choice["kept"])
    assert list(np.diff(start)) == expected


@settings(max_examples=40, deadline=None)
@given(choice=CHOICES)
def test_rays_depend_on_their_photograph_camera_and_kept_point(choice):
    network, _, rays = network_of(**choice)
    row, columns = ray_columns(network, rays)
    for i in range(0, len(rays), 17):
        own = columns[row[i]]
        assert (own[:6] == 6 * rays.photo[i] + np.arange(6)).all()
        assert (own[6 : 6 + len(network.estimated)] == network.interior_columns[0][network.estimated]).all()
        where = np.flatnonzero(network.kept == rays.point[i])
        if len(network.kept):
            assert (own[6 + len(network.estimated) :] == (network.kept_columns[where[0]] if len(where) else -1)).all()
        else:
            assert len(own) == 6 + len(network.estimated)


def test_prior_information_connects_photographs_with_the_shift_and_ends_of_distances():
    network, _, _ = network_of((0,), True, False, (3, 7, 9))
    network = replace(network, distances=Distances(np.array([[9, 3]]), np.ones(1), np.ones(1)))
    cliques = network.prior_cliques.toarray() > 0
    # Groups: four photographs, one camera, the shift, three kept points.
    assert [list(np.flatnonzero(row)) for row in cliques] == [[6, 8], [0, 5], [1, 5], [2, 5], [3, 5]]


def test_considered_columns_are_those_of_the_considered_parameters():
    network, _, _ = small_network(interior_free=(0, 3))
    considered = np.zeros((1, 8), bool)
    considered[0, 3] = True
    network = replace(network, interior=replace(network.interior, considered=considered))
    assert list(np.flatnonzero(network.considered_columns)) == [6 * 4 + 1]


def test_prior_observations_are_counted_as_numbers():
    network, _, _ = small_network(photos=4, interior_free=(0, 1, 3))
    assert network.prior_observations == 3 * 4 + 3 * 4 + 3
    more = replace(network, vertical_weight=np.full(4, 9.0), lever_weight=np.full(3, 4.0))
    assert more.prior_observations == network.prior_observations + 2 * 4 + 3
    height_only = replace(network, centre_weight=network.centre_weight * [0, 0, 1])
    assert height_only.prior_observations == network.prior_observations - 8


def test_considered_parameters_are_no_observations():
    network, _, _ = small_network(interior_free=(0, 1, 3))
    interior: Interior = network.interior
    considered = replace(network, interior=replace(interior, considered=interior.free))
    assert considered.prior_observations == network.prior_observations - 3


@pytest.mark.parametrize(("free", "weight", "defect"), [(False, 0.0, 0), (True, 0.0, 7), (True, 1.0, 6)])
def test_the_rank_defect_of_a_network(free, weight, defect):
    network, _, _ = small_network(free=free)
    network = replace(network, distances=Distances(np.array([[1, 2]]), np.ones(1), np.full(1, weight)))
    assert network.freedoms == defect


def test_a_free_network_has_neither_lever_arm_nor_shift():
    free, _, _ = small_network(free=True)
    assert free.with_antenna((1.0, 0.0, 0.0), 0.05, common_shift(4)) is free
    network, _, _ = small_network()
    known, estimated = (network.with_antenna((1.0, 0.0, 0.0), sigma, NOT_SHIFTED) for sigma in (0.0, 0.05))
    assert not len(known.lever_columns) and estimated.lever_columns.shape == (1, 3) and not known.shifts
    assert estimated.lever_weight == pytest.approx(np.full(3, 400.0))


def test_points_are_pointed_at_by_a_person_with_coordinates_or_by_name():
    network, _, _ = small_network(points=10)
    assert list(np.flatnonzero(replace(network, named=np.array([7])).pointed)) == [0, 1, 2, 3, 7]


def test_rays_are_taken_and_counted_by_point():
    index = np.array([0, 0, 2, 2, 2], np.int32)
    rays = Rays(index, np.arange(5, dtype=np.int32), np.arange(10.0).reshape(5, 2), np.ones(5))
    assert list(rays.first(4)) == [0, 2, 2, 5, 5]
    some = rays.take(np.array([True, False, True, False, True]))
    assert len(some) == 3 and list(some.photo) == [0, 2, 4] and list(some.first(3)) == [0, 1, 1, 3]


def test_a_distance_without_weight_has_an_infinite_standard_error():
    assert list(Distances(np.zeros((2, 2), int), np.ones(2), np.array([4.0, 0.0])).sigma) == [0.5, np.inf]
