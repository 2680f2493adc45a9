"""Where a photo was taken, from its view of the boards and the camera constant.

Source: Kawka 2021, S10, with signs for image coordinates with y up (methods/calibration.md).
"""

import numpy as np

from orthomill.tasks.geometry.rotation import nearest_rotation


def pose_of_view(view: np.ndarray, c: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) world to image and projection centre (3,) in the system of board 0.

    view: (3, 4), of whose plane Z = 0 the columns 0, 1 and 3 are a homography; its sign puts the boards before the camera. The
    principal point is the origin of the image coordinates.
    """
    M = np.diag([-1.0 / c, -1.0 / c, 1.0]) @ view[:, [0, 1, 3]]
    M *= 2.0 / (np.linalg.norm(M[:, 0]) + np.linalg.norm(M[:, 1]))
    R = nearest_rotation(np.column_stack([M[:, 0], M[:, 1], np.cross(M[:, 0], M[:, 1])]))
    return R, -R.T @ M[:, 2]
