"""The steps of an adjustment one by one, and what all of them together promise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from small_network import more_control, moved, small_network, surveyed_noise

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.adjustment_steps import (
    final_result,
    plain_solution,
    reweighted,
    with_reinstated_blunders,
    with_variance_components,
    without_ray_blunders,
    without_surveyed_blunder,
)
from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.network import Distances
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder, SurveyedKind
from orthomill.tasks.adjustment.progress import BlunderTest, Progress
from orthomill.tasks.adjustment.robust_solution import robust_solution
from orthomill.tasks.adjustment.testing.adjustment_result import AS_STATED, Factors


@pytest.fixture(scope="module")
def block():
    network, state, rays = small_network(seed=11, photos=6, points=90, noise=1.0)
    return surveyed_noise(more_control(network, 10), np.random.default_rng(11)), state, rays


def begun(block, test=None):
    network, state, rays = block
    return Progress(network, rays, test or BlunderTest(), network, state, np.ones(len(rays), bool))


def spoilt(rays, chosen, size=40.0):
    xy = rays.xy.copy()
    xy[chosen] += size
    return replace(rays, xy=xy)


def test_before_the_first_solution_there_is_no_result(block):
    with pytest.raises(ValueError, match="no plain solution yet"):
        _ = begun(block).solution


def test_the_plain_solution_is_up_to_date_and_counts_its_iterations(block):
    now = plain_solution(begun(block))
    assert not now.changed and now.iterations > 0 and now.rounds == 0
    assert now.solution.state is now.state and now.solution.factors is AS_STATED
    again = plain_solution(now)
    assert np.abs(again.state.centre - now.state.centre).max() < 1e-5


def test_factors_scale_rays_by_group_and_weights_of_what_was_surveyed(block):
    now = replace(begun(block), factors=Factors(2.0, 3.0, (4.0,), 5.0, 6.0))
    by_person = now.network.pointed[now.rays.point]
    assert now.weighted_rays.sigma == pytest.approx(now.rays.sigma * np.where(by_person, 3.0, 2.0))
    network = now.weighted_network
    assert network.centre_weight == pytest.approx(now.network.centre_weight / 16)
    assert network.point_weight == pytest.approx(now.network.point_weight / 25)
    ends = np.array([[20, 30]])
    now = replace(now, network=replace(now.network, kept=ends[0], distances=Distances(ends, np.ones(1), np.full(1, 36.0))))
    assert now.weighted_network.distances.weight == pytest.approx([1.0])


def test_variance_components_count_rounds_and_say_whether_they_changed(block):
    now = with_variance_components(plain_solution(begun(block)))
    assert now.rounds == 1 and now.changed and now.factors is AS_STATED
    later = with_variance_components(plain_solution(reweighted(now)))
    assert later.rounds == 2 and not later.changed
    assert later.estimated.image == pytest.approx(now.estimated.image, rel=0.01)


def test_a_wrong_ray_is_removed_and_the_others_of_its_point_stay(block):
    network, state, rays = block
    now = with_variance_components(plain_solution(begun((network, state, spoilt(rays, [300])))))
    less = without_ray_blunders(replace(now, changed=False))
    own = np.flatnonzero(rays.point == rays.point[300])
    assert less.changed and list(own[~less.used[own]]) == [300] and less.used.mean() > 0.99
    assert not without_ray_blunders(replace(with_variance_components(plain_solution(less)), changed=False)).changed


def test_points_left_with_one_ray_are_not_used(block):
    network, state, rays = block
    pair = rays.take((rays.point != 50) | (rays.photo < 2))
    own = np.flatnonzero(pair.point == 50)
    now = plain_solution(begun((network, state, spoilt(pair, own[:1]))))
    less = without_ray_blunders(with_variance_components(now))
    assert not less.used[own].any()


def test_a_wrong_control_point_is_rejected_and_the_block_solved_again(block):
    network, state, rays = block
    point = network.point.copy()
    point[4] += [0.5, 0.0, 0.0]
    now = without_surveyed_blunder(plain_solution(begun((replace(network, point=point), state, rays))))
    assert now.changed and [(b.kind, b.number) for b in now.blunders] == [(SurveyedKind.CONTROL, 4)]
    assert not now.network.point_weight[4].any() and now.first.point_weight[4].any()
    assert not without_surveyed_blunder(plain_solution(now)).changed


def test_a_suspect_that_agrees_without_itself_is_confirmed_and_not_examined_again(block):
    network, state, rays = block
    optimistic = replace(network, point_weight=network.point_weight * 4.0**2)
    now = without_surveyed_blunder(plain_solution(begun((optimistic, state, rays))))
    assert not now.changed and len(now.confirmed) == 1 and not now.blunders
    before = now.iterations
    again = without_surveyed_blunder(now)
    assert again.confirmed == now.confirmed and again.iterations == before


def test_a_good_observation_that_was_rejected_is_reinstated_once(block):
    network, _, _ = block
    rejected = begun(block).without(Blunder(SurveyedKind.CONTROL, 2, 9.0)).without(Blunder(SurveyedKind.POSITION, 1, 9.0))
    back = with_reinstated_blunders(plain_solution(rejected))
    assert back.changed and back.reinstated and back.blunders == ()
    assert (back.network.point_weight == network.point_weight).all()
    assert (back.network.centre_weight == network.centre_weight).all()
    again = plain_solution(back.without(Blunder(SurveyedKind.CONTROL, 2, 9.0)))
    assert with_reinstated_blunders(again) is again


def test_a_good_pointing_that_was_rejected_beside_a_wrong_one_is_reinstated(block):
    network, state, rays = block
    own = np.flatnonzero(network.pointed[rays.point])[:2]
    now = begun((network, state, spoilt(rays, own[:1])))
    back = with_reinstated_blunders(plain_solution(replace(now, used=~np.isin(np.arange(len(rays)), own))))
    assert back.changed and back.used[own].tolist() == [False, True] and with_reinstated_blunders(back) is back


def test_the_final_result_has_stated_rays_and_everything_that_was_found(block):
    now = with_variance_components(plain_solution(begun(block)))
    result = final_result(replace(now, blunders=(Blunder(SurveyedKind.CONTROL, 2, 9.0),)))
    assert result.rays is now.rays and result.factors is now.estimated and result.groups == now.groups
    assert result.iterations == now.iterations and len(result.blunders) == 1


@pytest.mark.parametrize("share", [0.02, 0.15])
def test_the_robust_solution_leaves_out_gross_rays(block, share):
    network, state, rays = block
    rng = np.random.default_rng(4)
    bad = rng.random(len(rays)) < share
    xy = rays.xy + bad[:, None] * rng.choice([-1, 1], rays.xy.shape) * rng.uniform(15, 300, rays.xy.shape)
    now = robust_solution(network, moved(state, rng, 0.5), replace(rays, xy=xy), BlunderTest())
    assert not now.used[bad].any() and now.used[~bad].mean() > 0.93 and not now.blunders
    assert np.abs(now.state.centre - state.centre).max() < 0.3


def test_the_robust_solution_rejects_gross_surveyed_observations_before_rays(block):
    network, state, rays = block
    point, centre = network.point.copy(), network.centre.copy()
    point[1] += [0.0, 3.0, 0.0]
    centre[5] += [8.0, 0.0, 0.0]
    now = robust_solution(replace(network, point=point, centre=centre), state, rays, BlunderTest())
    assert {(b.kind, b.number) for b in now.blunders} == {(SurveyedKind.CONTROL, 1), (SurveyedKind.POSITION, 5)}
    assert now.used[rays.point == 1].all(), "the rays of the wrong point are good"


def test_a_free_block_is_scaled_by_its_distances_and_a_wrong_one_left_out():
    network, state, rays = small_network(seed=3, photos=6, points=60, noise=0.5, free=True, interior_free=())
    ends = np.array([[5, 40], [6, 41], [7, 42], [8, 43]])
    length = np.linalg.norm(state.point[ends[:, 0]] - state.point[ends[:, 1]], axis=1)
    length[2] += 4.0
    network = replace(network, kept=np.unique(ends), named=np.unique(ends), distances=Distances(ends, length, np.full(4, 1e4)))
    start = replace(state, centre=0.5 * state.centre, point=0.5 * state.point)
    result = adjust(network, start, rays)
    assert [(b.kind, b.number) for b in result.blunders] == [(SurveyedKind.DISTANCE, 2)]
    base = [np.linalg.norm(s.centre[0] - s.centre[3]) for s in (result.state, state)]
    assert base[0] == pytest.approx(base[1], rel=2e-3)


@pytest.mark.parametrize(("name", "loose", "strict"), [("limit", 6.0, 2.5), ("gross", 1e3, 3.0)])
def test_limits_of_the_test_decide_how_many_rays_are_rejected(block, name, loose, strict):
    network, state, rays = block
    counts = [int(adjust(network, state, rays, BlunderTest(**{name: value})).used.sum()) for value in (loose, strict)]
    assert counts[0] > counts[1]


def test_the_limit_of_gross_surveyed_observations_is_their_own(block):
    network, state, rays = block
    centre = network.centre.copy()
    centre[2] += [0.9, 0.0, 0.0]
    found = [
        len(robust_solution(replace(network, centre=centre), state, rays, BlunderTest(gross_surveyed=limit)).blunders)
        for limit in (4.0, 20.0)
    ]
    assert found == [1, 0]


def test_hubers_limit_decides_how_strongly_outliers_pull(block):
    network, state, rays = block
    # A third of the rays of one photograph is displaced alike, as by a rolling shutter.
    own = np.flatnonzero((rays.photo == 2) & (rays.point % 3 == 0))
    xy = rays.xy.copy()
    xy[own, 0] += 3.0
    away = [
        np.linalg.norm(
            robust_solution(network, state, replace(rays, xy=xy), BlunderTest(huber=huber)).state.centre[2] - state.centre[2]
        )
        for huber in (1.0, 1e6)
    ]
    assert away[0] < away[1]


def test_an_adjustment_that_still_rejects_in_its_last_round_is_refused(block):
    network, state, rays = block
    with pytest.raises(GeometryError, match="last of 1 rounds; the tie points"):
        adjust(network, state, spoilt(rays, np.arange(100, 160, 7), 25.0), BlunderTest(gross=1e9, rounds=1))


def test_too_few_rays_are_refused(block):
    network, state, rays = block
    few = rays.take((rays.point >= 10) & (rays.point < 12) & (rays.photo < 2))
    with pytest.raises(GeometryError, match=r"not determined|not enough"):
        adjust(replace(network, point_weight=np.zeros_like(network.point_weight)), state, few)


def test_errors_of_adjusted_blocks_are_as_large_as_their_covariances_say():
    network, state, exact = small_network(seed=2, photos=4, points=50)
    network = more_control(network, 8)
    squares, points = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        noisy = replace(exact, xy=exact.xy + exact.sigma[:, None] * rng.standard_normal(exact.xy.shape))
        result = adjust(surveyed_noise(network, rng), moved(state, rng, 0.1), noisy)
        away = result.state.centre[1] - state.centre[1]
        squares.append(away @ np.linalg.solve(result.exterior_covariance(1)[:3, :3], away))
        moves = result.state.point[20:] - state.point[20:]
        points += list(np.einsum("ni,nij,nj->n", moves, np.linalg.inv(result.point_covariance[20:]), moves))
    # Each is chi-squared with three degrees of freedom.
    assert chi2.ppf(0.001, 24) < np.sum(squares) < chi2.ppf(0.999, 24)
    assert np.mean(points) == pytest.approx(3.0, rel=0.15)


def test_the_result_does_not_depend_on_the_system_of_coordinates(block):
    network, state, rays = block
    shift = np.array([100.0, -50.0, 20.0])
    other = replace(network, centre=network.centre + shift, point=network.point + shift)
    first = adjust(network, state, rays)
    second = adjust(other, replace(state, centre=state.centre + shift, point=state.point + shift), rays)
    assert np.abs(second.state.centre - shift - first.state.centre).max() < 1e-5
    assert (second.used == first.used).all() and second.factors.image == pytest.approx(first.factors.image, rel=1e-6)
    assert second.cofactor.variances == pytest.approx(first.cofactor.variances, rel=1e-4)


def test_doubling_all_stated_standard_errors_halves_the_factor_and_changes_nothing_else():
    network, state, rays = small_network(seed=6, photos=6, points=80, noise=1.0, free=True, interior_free=())
    first, second = adjust(network, state, rays), adjust(network, state, replace(rays, sigma=2 * rays.sigma))
    assert second.factors.image == pytest.approx(0.5 * first.factors.image, rel=0.02)
    assert np.abs(second.state.centre - first.state.centre).max() < 1e-3
    assert second.sigma0_px == pytest.approx(first.sigma0_px, rel=0.02)
    assert second.ray_sigma == pytest.approx(first.ray_sigma, rel=0.02)
