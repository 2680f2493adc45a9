"""What matching is measured against, on whole images: OpenCV's semi-global matching.

It takes a pair whose rows are homologous and gives parallaxes (column left - column right, px), NaN where it accepts nothing.
"""

import cv2
import numpy as np


def semi_global_opencv(left: np.ndarray, right: np.ndarray, low: float, high: float, checked: bool = False) -> np.ndarray:
    """(H, W) float32 of cv2.StereoSGBM, block 5, 3-way; low, high: parallaxes that can occur.

    checked: with its own tests (left-right 1 px, uniqueness 10 %, speckles of 100 px), else every value it can give.
    """
    cv2.setNumThreads(1)
    first = int(np.floor(low))
    count = -(-(int(np.ceil(high)) - first + 1) // 16) * 16
    wide = np.zeros((left.shape[0], left.shape[1] + count), np.uint8)
    wide[:, count:] = left
    moved = np.zeros_like(wide)
    target = np.arange(wide.shape[1]) - count - first
    inside = (target >= 0) & (target < right.shape[1])
    moved[:, inside] = right[: left.shape[0], target[inside]]
    tests = {"disp12MaxDiff": 1, "uniquenessRatio": 10, "speckleWindowSize": 100, "speckleRange": 2} if checked else {}
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=count, blockSize=5, P1=8 * 25, P2=32 * 25, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY, **tests
    )
    found = matcher.compute(wide, moved)[:, count:]
    return np.where(found >= 0, found / np.float32(16.0) + np.float32(first), np.float32(np.nan)).astype(np.float32)
