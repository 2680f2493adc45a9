"""Rotation matrices from quaternions (w, x, y, z) and back, for files of other programs."""

import numpy as np
from scipy.spatial.transform import Rotation


def rotation_of_quaternion(wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion (4,) of any length; it rotates vectors as q v q* does."""
    # SciPy keeps the scalar last, COLMAP first.
    return Rotation.from_quat(wxyz[[1, 2, 3, 0]]).as_matrix()


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """(4,) w, x, y, z of unit length with w >= 0 of a rotation matrix (3, 3)."""
    xyzw = Rotation.from_matrix(rotation).as_quat()
    # q and -q are the same rotation; one sign makes files comparable.
    return xyzw[[3, 0, 1, 2]] * (1.0 if xyzw[3] >= 0 else -1.0)
