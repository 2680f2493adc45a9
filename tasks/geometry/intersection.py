"""Forward intersection: the point nearest to two or more rays in space."""

import numpy as np


def intersect_rays(centres: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares intersection of rays.

    centres, directions: (K, N, 3), K rays for each of N points, directions of unit length. Returns points (N, 3) m and the root
    mean square distance of the rays from them (N,) m. Parallel rays give NaN.
    """
    identity = np.eye(3)
    # I - d d' projects onto the plane across a ray; the sum over rays is singular only where all of them are parallel. For two rays
    # its determinant is 2 sin^2 of their angle, so that 1e-12 is an angle of 7e-7 rad.
    projectors = identity - directions[..., :, None] * directions[..., None, :]
    normal = projectors.sum(axis=0)
    right = np.einsum("knij,knj->ni", projectors, centres)
    determinant = np.linalg.det(normal)
    singular = determinant < 1e-12
    normal[singular] = identity
    points = np.linalg.solve(normal, right[..., None])[..., 0]
    points[singular] = np.nan
    offsets = np.einsum("knij,knj->kni", projectors, points - centres)
    return points, np.sqrt((offsets**2).sum(axis=2).mean(axis=0))
