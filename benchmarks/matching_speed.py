"""Points per CPU-second of the kernels by size of the window, beside OpenCV's Lucas-Kanade tracker with same window and starts.

Single points with the start errors of the experiment; images are prepared before the clock starts, for OpenCV as well (it builds
its gradients inside the call, which is part of its work for each pair). The tracker solves two shifts, least squares six or eight
unknowns with their covariance.
"""

import time
from collections.abc import Callable

import cv2
import numpy as np

from benchmarks.matching_experiment import Band
from tasks.matching.least_squares import match_points, prepare
from tasks.matching.matching_model import Ellipse, LeastSquaresMatching, published

SIZES = (7, 11, 15, 21, 27, 35)
_REPETITIONS = 3


def per_second(count: int, work: Callable[[], object]) -> float:
    """Points per CPU-second, the best of some repetitions; the first call, which may compile, does not count."""
    work()
    seconds = []
    for _ in range(_REPETITIONS):
        started = time.process_time()
        work()
        seconds.append(time.process_time() - started)
    return count / min(seconds)


def recipes(size: int) -> dict[str, LeastSquaresMatching]:
    """What is measured for a size of the window."""
    return {
        "published square": published(size),
        "published ellipse": published(size, Ellipse()),
        "recommended, bicubic": LeastSquaresMatching(window=size),
        "recommended, bilinear": LeastSquaresMatching(window=size, interpolation="bilinear"),
        "recommended, bilinear, shift only": LeastSquaresMatching(window=size, interpolation="bilinear", geometry="shift"),
    }


def tracker(band: Band, size: int) -> Callable[[], object]:
    """OpenCV's tracker on one level, from the starts, with the stop limit of the recommended recipe."""
    cv2.setNumThreads(1)
    points, starts = (np.ascontiguousarray(table, dtype=np.float32).reshape(-1, 1, 2) for table in (band.points, band.starts))
    limits = cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02
    options = {"winSize": (size, size), "maxLevel": 0, "criteria": limits, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    shape = np.maximum(band.crop.left.shape, band.crop.right.shape)
    left, right = (np.pad(image, [(0, whole - part) for whole, part in zip(shape, image.shape, strict=True)])
                   for image in (band.crop.left, band.crop.right))
    return lambda: cv2.calcOpticalFlowPyrLK(left, right, points, starts.copy(), **options)


def speed_page(band: Band) -> list[str]:
    """Points per CPU-second, in thousands."""
    rows: dict[str, list[float]] = {}
    for size in SIZES:
        for name, settings in recipes(size).items():
            images = prepare(band.crop.left, settings), prepare(band.crop.right, settings)
            rows.setdefault(name, []).append(per_second(len(band.rows), lambda images=images, settings=settings: match_points(
                *images, band.points, band.starts, settings)))
        rows.setdefault("cv2.calcOpticalFlowPyrLK, one level", []).append(per_second(len(band.rows), tracker(band, size)))
    return ["| thousand points per CPU-second | " + " | ".join(f"{size} px" for size in SIZES) + " |",
            "| --- |" + " --- |" * len(SIZES),
            *(f"| {name} | " + " | ".join(f"{value / 1000:.1f}" for value in values) + " |" for name, values in rows.items())]
