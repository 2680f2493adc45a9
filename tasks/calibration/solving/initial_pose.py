"""The exterior orientation of a photo from its projection of the boards and the camera constant.

Source: Kawka 2021, S10, with signs for image coordinates with y up (sources/calibration.md).
"""

import numpy as np

from orthomill.tasks.geometry.rotation import nearest_rotation


def pose_of_projection(projection: np.ndarray, c: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) world to image and projection centre (3,) in the system of board 0.

    projection: (3, 4), whose columns 0, 1 and 3 are the homography of the plane Z = 0, with the sign that puts the boards in front
    of the camera; c: px. The principal point is the origin of the image coordinates.
    """
    M = np.diag([-1.0 / c, -1.0 / c, 1.0]) @ projection[:, [0, 1, 3]]
    # The first two columns of a rotation have length 1; noise and an inexact c leave two lengths, and their mean gives the scale.
    M *= 2.0 / (np.linalg.norm(M[:, 0]) + np.linalg.norm(M[:, 1]))
    R = nearest_rotation(np.column_stack([M[:, 0], M[:, 1], np.cross(M[:, 0], M[:, 1])]))
    return R, -R.T @ M[:, 2]
