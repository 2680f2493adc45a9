"""Steps: the motion of the whole block is taken as what it is, and the rest as corrections."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_network import moved, small_network

from orthomill.tasks.adjustment.model.collinearity import residual_lengths
from orthomill.tasks.adjustment.model.datum import freedoms
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED
from orthomill.tasks.adjustment.solve.bundle_step import BundleStep, step_of
from orthomill.tasks.adjustment.solve.minimise import NEAR, minimise
from orthomill.tasks.adjustment.solve.whole_block import WholeMotion, motion_in

Numbers = st.lists(st.floats(-0.3, 0.3), min_size=7, max_size=7).map(np.array)


def step_along(state, numbers):
    """The linear step of a motion of the whole block with these numbers (7,)."""
    middle = state.centre.mean(axis=0)
    size = np.linalg.norm(state.centre - middle, axis=1).mean()
    motion = WholeMotion(numbers, middle, size)
    turn = -np.einsum("pij,j->pi", state.rotation, numbers[3:6])
    nothing = np.zeros_like(state.interior), np.zeros(3), np.zeros(3)
    return motion, BundleStep(motion.linear(state.centre), turn, motion.linear(state.point), *nothing)


@given(Numbers)
@settings(deadline=None, max_examples=25)
def test_a_motion_of_the_block_is_found_in_its_linear_step_and_changes_no_image(numbers):
    network, state, rays = small_network(2, noise=1.0)
    motion, step = step_along(state, numbers)
    assert motion_in(state, step.centre, step.turn).numbers == pytest.approx(numbers, abs=1e-9)
    reached = step.with_motion(state)
    assert np.abs(reached.centre - motion.of(state, np.arange(30)).centre).max() < 1e-9
    assert np.abs(residual_lengths(network, reached, rays) - residual_lengths(network, state, rays)).max() < 1e-5


def test_the_linear_step_of_a_turn_changes_the_images():
    network, state, rays = small_network(2)
    _, step = step_along(state, np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0]))
    assert residual_lengths(network, step.linear(state), rays).max() > 1.0


def test_the_motions_are_the_freedoms_of_a_free_network():
    network, state, _ = small_network(4, free=True)
    H = freedoms(network, state)
    for k, numbers in enumerate(np.eye(7)):
        _, step = step_along(state, numbers)
        column = np.hstack([step.centre, step.turn]).ravel()
        # The freedoms shift by metres, the motions by the size of the block.
        expected = H[: 6 * network.photos, k] * (np.linalg.norm(column) / np.linalg.norm(H[: 6 * network.photos, k]))
        assert column == pytest.approx(expected, abs=1e-9)


def test_corrections_reach_the_unknowns_that_they_belong_to():
    network, _, _ = small_network(3, interior_free=(0, 3))
    network = replace(network, kept=np.array([2, 5]), lever_weight=np.ones(3))
    correction = np.arange(network.unknowns, dtype=float)
    step = step_of(network, correction, np.zeros((30, 3)))
    assert (step.centre[1] == [6, 7, 8]).all() and (step.turn[1] == [9, 10, 11]).all()
    assert (step.interior[0] == [24, 0, 0, 25, 0, 0, 0, 0]).all()
    assert (step.shift == [26, 27, 28]).all() and (step.lever == [29, 30, 31]).all()
    assert (step.point[[2, 5]] == [[32, 33, 34], [35, 36, 37]]).all() and not step.point[[0, 1, 3]].any()


def test_control_of_metres_does_not_slow_the_minimisation():
    network, truth, rays = small_network(6, photos=9, points=60, noise=1.0, interior_free=())
    weight = np.zeros_like(network.point_weight)
    weight[:5] = 1e-4
    rough = replace(network, point_weight=weight, centre_weight=0.0 * network.centre_weight, shift=NOT_SHIFTED)
    rough = replace(rough, point=network.point + np.random.default_rng(1).normal(0, 5.0, network.point.shape))
    _, steps = minimise(rough, moved(truth, np.random.default_rng(2), 0.05), rays, damping=NEAR)
    assert steps <= 5


def test_a_part_of_a_step_is_that_part_of_every_correction():
    network, state, _ = small_network(3, interior_free=(0, 3))
    whole = step_of(network, np.arange(network.unknowns, dtype=float), np.ones_like(state.point))
    half, all_of_it = whole.times(0.5).linear(state), whole.linear(state)
    for name in ("centre", "point", "interior", "shift"):
        before = getattr(state, name)
        assert getattr(half, name) - before == pytest.approx((getattr(all_of_it, name) - before) / 2, abs=1e-9)
    assert whole.times(1.0) is whole
