"""A small bundle over uneven ground with everything that an adjustment may know, for tests against dense least squares."""

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from orthomill.tasks.adjustment.model.collinearity import derivatives, residuals
from orthomill.tasks.adjustment.model.datum import add_prior
from orthomill.tasks.adjustment.model.linearisation import linearised, structure
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Interior, Network, Rays, State, common_shift, ray_columns
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, pattern_of
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector

INTERIOR_VALUES = np.array([1000.0, 3.0, -2.0, -0.05, 0.02, -0.01, 1e-3, -5e-4])


def small_network(seed=0, photos=4, points=30, noise=0.0, free=False, interior_free=(0, 1, 3)):
    """Photos over uneven ground, each point in all of them; GNSS on every photo unless free, control on the first four points."""
    rng = np.random.default_rng(seed)
    rotation = np.array([rotation_matrix(*(0.05 * rng.standard_normal(3) + [0, 0, k])) for k in rng.uniform(0, 6, photos)])
    centre = np.column_stack([40 * (np.arange(photos) % 2), 40 * (np.arange(photos) // 2), 100 + rng.normal(0, 3, photos)])
    point = np.column_stack([rng.uniform(-10, 50, (points, 2)), rng.normal(0, 6, points)])
    state = State(rotation, centre, point, INTERIOR_VALUES[None], np.zeros(3))
    index = np.repeat(np.arange(points), photos).astype(np.int32), np.tile(np.arange(photos), points).astype(np.int32)
    camera_of = np.zeros(photos, np.int64)
    rays = Rays(*index, np.zeros((points * photos, 2)), rng.uniform(0.2, 0.6, points * photos))
    rays = replace(rays, xy=-residuals(state, rays, camera_of) + noise * rays.sigma[:, None] * rng.standard_normal((len(rays), 2)))
    mask = np.isin(np.arange(8), interior_free)[None]
    weight = np.zeros((1, 8, 8))
    weight[0][np.ix_(mask[0], mask[0])] = np.diag(1 / np.array([2.0, 1, 1, 0.01, 0.01, 0.01, 1e-3, 1e-3])[mask[0]] ** 2)
    known = np.zeros((points, 3))
    known[:4] = 0 if free else 1 / 0.02**2
    network = Network(
        camera_of,
        Interior(INTERIOR_VALUES[None], weight, mask, np.zeros_like(mask)),
        centre,
        np.full((photos, 3), 0 if free else 1 / 0.1**2),
        point,
        known,
        np.zeros(photos),
        shift=NOT_SHIFTED if free else common_shift(photos),
        free=free,
    )
    return network, state, rays


def more_control(network, count):
    """The network with control on its first `count` points, 2 cm."""
    weight = network.point_weight.copy()
    weight[:count] = 1 / 0.02**2
    return replace(network, point_weight=weight)


def surveyed_noise(network, rng, position=1.0, control=1.0):
    """The network with errors in its positions and control, in multiples of their stated standard errors."""
    point_sigma, centre_sigma = (
        np.divide(1.0, np.sqrt(weight), out=np.zeros_like(weight, float), where=weight > 0)
        for weight in (network.point_weight, network.centre_weight)
    )
    point = network.point + control * point_sigma * rng.standard_normal(network.point.shape)
    return replace(
        network, point=point, centre=network.centre + position * centre_sigma * rng.standard_normal(network.centre.shape)
    )


def moved(state, rng, size=1.0):
    """The state with errors of `size` m in centres and points, and of 0.01 `size` rad in rotations."""
    turned = np.array([rotation_of_vector(0.01 * size * rng.standard_normal(3)) @ R for R in state.rotation])
    return replace(
        state,
        rotation=turned,
        centre=state.centre + size * rng.standard_normal(state.centre.shape),
        point=state.point + size * rng.standard_normal(state.point.shape),
    )


def pattern(network, state, rays):
    """The blocks of the reduced normal matrix."""
    return structure(network, state, linearised(network, state, rays)).pattern


def prior_alone(network, state):
    """Normal matrix and right-hand side of what is known beforehand."""
    whole = pattern_of(network.group_start, csr_array(np.ones((1, len(network.group_start) - 1))))
    matrix = BlockMatrix.zero(whole)
    right = add_prior(network, state, matrix)
    return matrix.dense(), right


def dense(network, state, rays):
    """The whole design matrix, plain NumPy: unknowns of the reduced system first, then the points."""
    (row, columns), (jg, jp) = ray_columns(network, rays), derivatives(state, rays, network.camera_of, network.estimated)
    n, N = network.unknowns, len(state.point)
    A = np.zeros((len(rays), 2, n + 3 * N))
    for i in range(len(rays)):
        for a, column in enumerate(columns[row[i]]):
            if column >= 0:
                A[i, :, column] = jg[i, :, a]
        A[i, :, n + 3 * rays.point[i] : n + 3 * rays.point[i] + 3] = jp[i]
    A = A.reshape(-1, n + 3 * N)
    P = np.repeat(1 / rays.sigma**2, 2)
    normal, right = A.T @ (P[:, None] * A), A.T @ (P * residuals(state, rays, network.camera_of).ravel())
    prior, prior_right = prior_alone(network, state)
    normal[:n, :n] += prior
    right[:n] += prior_right
    normal[n:, n:] += np.diag(network.point_weight.ravel())
    right[n:] += (network.point_weight * (network.point - state.point)).ravel()
    return A, normal, right
