"""Small rotations as vectors: R <- exp([w]x) R. No attitude is singular, as with three angles; angles are for reports and files."""

import numpy as np

from orthomill.tasks.geometry.rotation import angles, rotation_derivatives


def skew(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3): the matrices of the vector products v x of vectors (..., 3)."""
    v = np.asarray(v)
    matrix = np.zeros((*v.shape, 3))
    for first, second, third in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., first, second], matrix[..., second, first] = -v[..., third], v[..., third]
    return matrix


def motion_derivatives(lever: np.ndarray) -> np.ndarray:
    """(..., 3, 7): how places move that lie `lever` (..., 3) from the middle of a body, by the body's shift, its rotation vector
    and the logarithm of its scale."""
    shift = np.broadcast_to(np.eye(3), (*lever.shape, 3))
    return np.concatenate([shift, -skew(lever), lever[..., None]], axis=-1)


def rotation_of_vector(w: np.ndarray) -> np.ndarray:
    """exp([w]x): the rotation by |w| radians about w (Rodrigues)."""
    angle = float(np.linalg.norm(w))
    K = skew(w)
    # The quotients are 0 / 0 at 0; below 1e-6 the terms left out are smaller than 1e-18.
    if angle < 1e-6:
        return np.eye(3) + K + 0.5 * K @ K
    return np.eye(3) + np.sin(angle) / angle * K + (1.0 - np.cos(angle)) / angle**2 * K @ K


def vector_of_rotation(R: np.ndarray) -> np.ndarray:
    """The rotation vector (3,) of R, of length 0 to pi."""
    sine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    # arctan2 of sine and cosine: the arccosine of the trace alone has only 1e-8 rad near 0 and near pi.
    cosine, length = 0.5 * (np.trace(R) - 1.0), float(np.linalg.norm(sine))
    if length > 1e-9:
        return sine / length * np.arctan2(length, cosine)
    if cosine > 0.0:
        return sine
    # At pi the antisymmetric part vanishes; the axis is the eigenvector of R + R' of eigenvalue 2. Its sign is arbitrary there.
    axis = np.linalg.eigh(R + R.T)[1][:, 2]
    return np.pi * axis


def vectors_of_rotations(R: np.ndarray) -> np.ndarray:
    """The rotation vectors (n, 3) of rotations (n, 3, 3), as `vector_of_rotation` gives each."""
    sine = 0.5 * np.column_stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]])
    cosine, length = 0.5 * (R.trace(axis1=1, axis2=2) - 1.0), np.linalg.norm(sine, axis=1)
    turned = length > 1e-9
    by_sine = np.where(turned, np.arctan2(length, cosine) / np.where(turned, length, 1.0), 1.0)
    found = by_sine[:, None] * sine
    for i in np.flatnonzero(~turned & (cosine < 0.0)):
        found[i] = vector_of_rotation(R[i])
    return found


def angles_from_vector(R: np.ndarray) -> np.ndarray:
    """(3, 3): derivatives of omega, phi, kappa by the rotation vector at R.

    At phi = 90 degrees, where omega and kappa turn about the same axis, only the part that is defined.
    """
    # D R' is antisymmetric: the rotation vector per unit of each angle. Its columns become dependent at gimbal lock, so that a
    # plain inverse would make standard errors of reports infinite there.
    by_angle = rotation_derivatives(*angles(R))
    columns = [(D @ R.T) for D in by_angle]
    return np.linalg.pinv(np.column_stack([[K[2, 1], K[0, 2], K[1, 0]] for K in columns]))
