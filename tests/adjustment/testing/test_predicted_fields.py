"""Fields of image errors predicted from positions and control: against dense algebra, and on blocks with known errors."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import dense, small_network

from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.datum import standardised_prior
from orthomill.tasks.adjustment.solve.minimise import NEAR, minimise
from orthomill.tasks.adjustment.testing.adjustment_result import CorrelatedErrors
from orthomill.tasks.adjustment.testing.error_field_precision import with_correlated_errors
from orthomill.tasks.adjustment.testing.error_fields import TERMS, displacements, field_basis, weighted_rays
from orthomill.tasks.adjustment.testing.predicted_fields import predicted_fields

FRAME = np.array([1500.0, 1300.0])
POINTS = 80


def drawn(seed, rms, share, position=0.03, photos=6):
    """A block with noise, fields of `rms` px and positions of a standard error (m): the network, the state to start with, the
    rays, and the true centres."""
    network, state, exact = small_network(photos=photos, points=POINTS, interior_free=(0, 1, 2, 3))
    rng = np.random.default_rng(seed)
    centre = network.centre + position * rng.standard_normal(network.centre.shape)
    weight = np.full_like(network.centre_weight, 1.0 / position**2)
    nothing = np.zeros_like(network.point_weight)
    network = replace(network, centre=centre, centre_weight=weight, point_weight=nothing, shift=network.shift[:0])
    own, common = rng.standard_normal((photos, 2, TERMS)), rng.standard_normal((2, TERMS))
    coefficients = rms / np.sqrt(TERMS) * (np.sqrt(1 - share) * own + np.sqrt(share) * common)
    noise = exact.sigma[:, None] * rng.standard_normal(exact.xy.shape)
    size = np.tile(FRAME, (photos, 1))
    rays = replace(exact, xy=exact.xy + noise + displacements(exact, size, coefficients))
    return network, state, rays, size


def less(rays, size, fields):
    return replace(rays, xy=rays.xy - displacements(rays, size, fields.coefficients))


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_the_second_adjustment_combines_the_block_by_rays_with_all_else(share):
    """By dense algebra: the block by rays alone, with the covariance of noise and fields, and positions and control by their
    weights; nothing is known of the camera."""
    network, state, rays, size = drawn(1, 0.3, share)
    network = replace(network, interior=replace(network.interior, weight=1e-8 * network.interior.weight))
    errors = CorrelatedErrors(0.3, share, 100.0, 0.5)
    before = adjust(network, state, rays)
    fields = predicted_fields(before, errors, size)
    corrected = replace(less(rays, size, fields), sigma=before.ray_sigma).take(before.used)
    after, _ = minimise(before.network, before.state, corrected, damping=NEAR)
    # As they are at the first solution: all rays by their weights, and what is known besides.
    used = weighted_rays(before)
    A, normal, _ = dense(before.network, before.state, used)
    weights = np.repeat(1 / used.sigma**2, 2)
    by_rays = A.T @ (weights[:, None] * A)
    B = np.zeros((len(used), 2, network.photos, 2, TERMS))
    for k in range(2):
        B[np.arange(len(used)), k, used.photo, k] = field_basis(used.xy, size[used.photo])
    pull = A.T @ (weights[:, None] * B.reshape(len(A), -1))
    C = 0.3**2 / TERMS * np.kron((1 - share) * np.eye(network.photos) + share, np.eye(2 * TERMS))
    # The datum, which rays do not know, to within kilometres: then their normal matrix has an inverse.
    scale = np.sqrt(np.diag(by_rays))
    inverse = np.linalg.inv(by_rays / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))) / np.outer(scale, scale)
    alone = np.linalg.inv(inverse + inverse @ pull @ C @ pull.T @ inverse)
    other = normal - by_rays
    # At the first solution the rays pull by what all else pulls against them, that is by the step to the block by rays alone.
    pulled = np.zeros(len(normal))
    derivatives, residual = standardised_prior(before.network, before.state)
    pulled[: before.network.unknowns] = derivatives.T @ residual
    expected = np.linalg.solve(alone + other, pulled - alone @ inverse @ pulled)
    moved = (after.centre - before.state.centre).ravel()
    centres = (6 * np.arange(network.photos)[:, None] + np.arange(3)).ravel()
    assert np.linalg.norm(moved) > 1e-3
    assert np.allclose(moved, expected[centres], atol=0.03 * np.abs(expected[centres]).max())


def repeated(share, seeds=5):
    """Errors of centres (seeds, P, 3) before and after, and what is stated (seeds, P, 3) after."""
    errors = CorrelatedErrors(0.5, share, 100.0, 0.5)
    truth = small_network(photos=6, points=POINTS)[1].centre
    before, after, stated = [], [], []
    for seed in range(seeds):
        network, state, rays, size = drawn(seed, 0.5, share)
        first = adjust(network, state, rays)
        second = adjust(network, first.state, less(rays, size, predicted_fields(first, errors, size)))
        known = predicted_fields(second, errors, size).known
        covered = with_correlated_errors(second, errors, size, known)
        before.append(first.state.centre - truth)
        after.append(second.state.centre - truth)
        stated.append(np.sqrt([np.diag(covered.exterior_covariance(i))[:3] for i in range(len(truth))]))
    return np.array(before), np.array(after), np.array(stated)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_centres_improve_and_have_the_stated_errors(share):
    before, after, stated = repeated(share)
    assert np.sqrt((after**2).mean()) < 0.8 * np.sqrt((before**2).mean())
    assert 0.7 < np.sqrt(np.mean((after / stated) ** 2)) < 1.3


def test_what_is_known_of_cameras_beforehand_takes_no_part():
    network, state, _, _ = drawn(3, 0.3, 0.6)
    derivatives, _ = standardised_prior(network, state)
    columns = network.interior_columns[network.interior_columns >= 0]
    assert len(columns) and not derivatives[:, columns].count_nonzero()
