"""Bad control is one factor, a blunder is a blunder: in blocks of small size, over several seeds."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import more_control, small_network, surveyed_noise

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.bundle import BlunderTest, adjust
from orthomill.tasks.adjustment.explained_control import without_unmet
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED
from orthomill.tasks.adjustment.solve.minimise import minimise


def adjusted(points, seed, factor=1.0, blunder=0.0, gnss=3.0):
    """The wrong point, and the adjustment of a block whose control has errors of `factor` standard errors and one `blunder` (m)."""
    rng = np.random.default_rng(seed)
    network, state, rays = small_network(seed, photos=6, points=60, noise=1.0)
    weight = np.full_like(network.centre_weight, 1 / gnss**2)
    network = replace(more_control(network, points), shift=NOT_SHIFTED, centre_weight=weight)
    network = surveyed_noise(network, rng, control=factor)
    point, wrong, away = network.point.copy(), int(rng.integers(points)), rng.standard_normal(3)
    point[wrong] += blunder * away / np.linalg.norm(away)
    return wrong, adjust(replace(network, point=point), state.with_antenna(network), rays)


@pytest.mark.parametrize(("points", "seed"), [(5, 0), (5, 1), (5, 2), (8, 0), (8, 1)])
def test_control_that_is_all_bad_keeps_its_points_and_gets_one_factor(points, seed):
    _, result = adjusted(points, seed, factor=25.0)
    assert result.blunders == () and 25 / 2 < result.factors.control < 25 * 2


@pytest.mark.parametrize(("points", "size", "seed"), [(4, 3.0, 0), (5, 3.0, 0), (5, 3.0, 1), (5, 0.5, 2), (8, 3.0, 3)])
def test_one_blunder_among_good_control_is_named_and_the_others_keep_their_standard_errors(points, size, seed):
    wrong, result = adjusted(points, seed, blunder=size)
    assert [blunder.number for blunder in result.blunders] == [wrong] and result.factors.control == 1.0


def test_standard_errors_that_creep_end_an_adjustment_but_rays_that_are_still_rejected_do_not():
    network, state, rays = small_network(4, photos=6, points=60, noise=1.0)
    one_round = BlunderTest(rounds=1)
    assert adjust(network, state, replace(rays, sigma=rays.sigma / 3.0), one_round).used.all()
    rays.xy[100] += 5.0 * rays.sigma[100]
    with pytest.raises(GeometryError, match="still rejected rays in the last of 1 rounds"):
        adjust(network, state, rays, one_round)


def test_rays_that_do_not_meet_leave_a_block_with_loosened_control_its_scale():
    network, state, rays = small_network(2, photos=6, points=60, noise=1.0)
    network = replace(more_control(network, 7), shift=NOT_SHIFTED, centre_weight=np.zeros_like(network.centre_weight))
    network = surveyed_noise(network, np.random.default_rng(2), control=50.0)
    loose = replace(network, point_weight=network.point_weight / 90.0**2)
    # People measure a point in a few photographs; of the first one, two are of other places, and the rays diverge.
    rays = rays.take((rays.point >= 7) | (rays.photo % 3 == 0) | ((rays.point == 0) & (rays.photo == 1)))
    rays = replace(rays, sigma=np.where(rays.point < 7, 1.0, rays.sigma))
    first, second = np.flatnonzero(rays.point == 0)[:2]
    for own, other in ((first, second), (second, first)):
        i, k = rays.photo[[own, other]]
        away = (state.rotation[i] @ (state.centre[i] - state.centre[k]))[:2]
        rays.xy[own] += 800.0 * away / np.linalg.norm(away)

    def scale(network, rays):
        found, _ = minimise(network, state, rays, 2.0, 1e-3)
        return float((np.ptp(found.centre, axis=0)[:2] / np.ptp(state.centre, axis=0)[:2]).mean())

    assert scale(loose, rays) < 0.5, "what this test is about: the whole block shrinks to bring two rays together"
    assert scale(*without_unmet(loose, state, rays, 6.0)) == pytest.approx(1.0, abs=0.1)
