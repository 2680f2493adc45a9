"""Where a photo was taken, from a homography and the camera constant, with the sign that puts the boards before the camera.

Source: Kawka 2021, S10, with signs for image coordinates with y up (methods/calibration.md).
"""

import numpy as np


def pose_of_homography(H: np.ndarray, c: float, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) world to image and projection centre (3,) in the system of the plane; `seen` (2,) is a point that the photo
    shows. The principal point is the origin of the image coordinates."""
    M = np.diag([-1.0 / c, -1.0 / c, 1.0]) @ H
    M *= 2.0 / (np.linalg.norm(M[:, 0]) + np.linalg.norm(M[:, 1]))
    if M[2] @ np.append(seen, 1.0) > 0.0:
        M = -M
    U, _, V = np.linalg.svd(np.column_stack([M[:, 0], M[:, 1], np.cross(M[:, 0], M[:, 1])]))
    R = U @ V
    return R, -R.T @ M[:, 2]
