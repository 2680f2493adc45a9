"""The two published pairs, Volos and Kea: relative orientations, and image coordinates of homologous points."""

import numpy as np

from orthomill.tasks.geometry.rotation import rotation_matrix

VOLOS = (0.0382, -0.0084, *np.radians([0.9721, 0.6725, 1.8082]))
KEA = (-0.0450, -0.0085, *np.radians([1.6902, -0.0555, -2.5862]))
C = 153.353 / 0.064


def matches(truth, count, seed, noise=0.0, base_height=582 / 1029, c=C):
    """(count, 4) image coordinates over the common part of a pair with 60 % overlap, gentle relief."""
    rng = np.random.default_rng(seed)
    depth = -1 / base_height * (1 + 0.05 * rng.standard_normal(count))
    reach = 0.75 / base_height
    points = np.column_stack([rng.uniform(1 - reach, reach, count), rng.uniform(-reach, reach, count), depth])
    R = rotation_matrix(*truth[2:])
    turned = (points - [1, truth[0], truth[1]]) @ R.T
    ideal = np.hstack([-c * points[:, :2] / points[:, 2:], -c * turned[:, :2] / turned[:, 2:]])
    return ideal + noise * rng.standard_normal(ideal.shape)


def kea_case(seed):
    observations = matches(KEA, 154, 100 + seed, 0.2, 829 / 1525, 152.52 / 0.049)
    rng = np.random.default_rng(seed)
    observations[36:, 2:] += rng.uniform(-190, 190, (118, 2))
    return observations
