"""The stated precision of the shape: that of the whole adjustment, and what happens over many blocks."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient
from simulated_block import DRONE, one_strip, simulate, view
from small_network import small_network

from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.interior import UNKNOWN_SIGMA
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.solve.minimise import NotConverged
from orthomill.tasks.adjustment.testing.adjustment_result import Factors
from orthomill.tasks.adjustment.testing.covariances import covariance_of
from orthomill.tasks.adjustment.testing.solution_precision import precise_solution
from orthomill.tasks.adjustment.testing.variance_components import position_covariances
from orthomill.tasks.orientation.shape.held_parameters import held_sigmas, moment, with_held
from orthomill.tasks.orientation.shape.shape_precision import bend_forms, form_covariance

SIZE = np.tile([1000.0, 800.0], (4, 1))


@pytest.mark.parametrize("free", [False, True], ids=["positions and control", "no datum"])
def test_the_covariance_of_bends_is_that_of_all_points_together(free):
    network, state, rays = small_network(free=free)
    used, points = np.ones(len(rays), bool), np.arange(len(state.point))
    result = precise_solution(network, state, rays, used, Factors())
    forms = bend_forms(state.point[:, :2])[0]
    # Inner constraints on the photographs alone are another datum than on photographs and points: of their difference tilts are
    # in no form, but the scale of uneven ground is.
    scaled = np.column_stack([np.ones(len(points)), state.point])
    forms = np.linalg.qr(forms - scaled @ np.linalg.lstsq(scaled, forms, rcond=None)[0])[0] * np.sqrt(len(points))
    # With all points among the unknowns their joint covariance is simply there.
    whole = replace(network, kept=points)
    cofactor = covariance_of(whole, state, linearised(whole, state, rays))
    heights = np.zeros((len(cofactor), 3))
    heights[whole.kept_columns[:, 2]] = forms / len(points)
    expected = heights.T @ cofactor.times(heights)
    found = form_covariance(result, points, forms, SIZE)
    assert np.allclose(found, expected, rtol=1e-6)


@pytest.mark.slow
def test_bends_scatter_as_stated():
    """Forty blocks with noise of all observations: whitened coefficients of the bends have unit variance."""
    squares = []
    for seed in range(40):
        network, state, rays = small_network(seed=seed, points=40, noise=1.0)
        try:
            result = adjust(network, state, rays)
        except NotConverged:
            continue
        forms, _ = bend_forms(state.point[:, :2])
        coefficients = forms.T @ (result.state.point - state.point)[:, 2] / len(forms)
        found = form_covariance(result, np.arange(len(forms)), forms, SIZE)
        squares.append(coefficients @ np.linalg.solve(found, coefficients))
    # Positions and control have no errors here, so that bends are a little smaller than stated.
    assert len(squares) >= 35
    assert 0.5 < np.mean(squares) / 3 < 1.4


def test_a_bend_has_no_plane_and_a_narrow_block_none_across():
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, [200, 40], (300, 2))
    forms, extent = bend_forms(xy + np.array([4e5, 4e6]))
    plane = np.column_stack([np.ones(300), xy])
    assert np.allclose(forms.T @ forms / 300, np.eye(3), atol=1e-9) and np.abs(plane.T @ forms).max() < 1e-6
    assert extent == pytest.approx(200, rel=0.03)
    assert bend_forms(rng.uniform(0, [200, 4], (300, 2)))[0].shape == (300, 2)


def test_what_a_block_says_bounds_a_held_parameter_and_its_wish_enlarges_it():
    prior = np.array([10.0, 0.3])
    silent = np.diag(prior**2)
    assert np.allclose(moment(silent, np.zeros(2), prior, 1.0), silent)
    telling = np.diag([1.0, 1e-4])
    assert np.allclose(moment(telling, np.zeros(2), prior, 1.0), telling)
    # A hundred times the variance of what the observations say, here nearly all of it.
    assert moment(telling, np.zeros(2), prior, 50.0)[0, 0] == pytest.approx(50.0 / 1.5, rel=0.03)
    wanting = moment(telling, np.array([4.0, 0.0]), prior, 1.0)
    assert wanting[0, 0] == pytest.approx(1.0 + 16.0)


def test_the_covariance_as_computed_keeps_the_unknowns_that_it_has():
    """Held parameters are columns that it lacks: the common shift of positions, which comes last, would be read beyond its end."""
    network, state, rays = small_network(noise=1.0)
    plain = precise_solution(network, state, rays, np.ones(len(rays), bool), Factors())
    held = with_held(plain, np.where(np.arange(8) == 5, 0.02, 0.0)[None])
    assert held.network.unknowns == len(held.cofactor) == plain.network.unknowns + 1
    assert held.as_computed.network.unknowns == len(held.as_computed.cofactor) == plain.network.unknowns
    photos = np.arange(network.photos)
    assert np.array_equal(position_covariances(held.as_computed, photos), position_covariances(plain, photos))
    assert np.isfinite(position_covariances(held, photos)).all()


def test_only_cameras_from_tags_have_held_parameters():
    sigma = held_sigmas(DRONE)
    assert sigma[0] == 0 and sigma[5] == UNKNOWN_SIGMA["k3"] and sigma[1] > 0
    assert not held_sigmas(DRONE.model_copy(update={"source": "file"})).any()


def strip(seed):
    """A nadir strip whose camera differs from its tags as lenses do."""
    rng = np.random.default_rng([5, seed])
    own = {"x0": 12 * rng.standard_normal(), "y0": 12 * rng.standard_normal(), "k3": 0.01 * rng.standard_normal()}
    camera = DRONE.changed(k1=-0.02, **own)
    places = [
        ((407000 + 20 * i, 4357000 + 35 * s, 180.0), (*rng.normal(0, 1, 2), 90.0 + 180 * s)) for s in (0, 1) for i in range(5)
    ]
    views = [view(f"d{i}", camera, *place) for i, place in enumerate(places)]
    return simulate(views, DRONE.changed(c=1165.0, k1=0.0), seed, gnss=3.0, control=0, check=0, tracks=200)


def bend(block, points):
    """The range of the quadratic part of the errors of heights."""
    points = points.take(np.flatnonzero(points.rays >= 3))
    truth = block.ground[points.track]
    error = points.z - truth[:, 2]
    forms, _ = bend_forms(truth[:, :2])
    plane = np.column_stack([np.ones(len(truth)), truth - truth.mean(axis=0)])
    error = error - plane @ np.linalg.lstsq(plane, error, rcond=None)[0]
    return np.ptp(forms @ (forms.T @ error) / len(forms))


@pytest.mark.slow
def test_cameras_that_differ_from_their_tags_bend_blocks_by_what_is_stated():
    ratios = []
    for seed in range(14):
        block = strip(seed)
        out = orient(block)
        ratios.append(bend(block, out["points"]) / out["precision"].bend_sigma)
    # The range of all three forms by the standard error of the least known one.
    assert np.mean(np.array(ratios) > 2.0) <= 0.1
    assert 0.15 < np.sqrt(np.mean(np.square(ratios))) < 1.7


def test_k3_that_is_held_reaches_cameras_and_heights():
    """It is in the covariances of the block, from which the datum layer of the surface is made."""
    block = one_strip(1)
    out = orient(block)
    camera, photo = out["block"].cameras["cam"], out["block"].photos[0]
    assert camera.covariance[5][5] > 0
    assert np.abs(np.array(photo.with_interior["cam"])[:, 5]).max() > 0
    assert 0 < out["precision"].bend_sigma < 5 and 100 < out["precision"].bend_extent < 400
