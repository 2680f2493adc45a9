"""How many points per CPU-second least-squares matching processes: `python -m benchmarks matching_speed`.

One thread, one pair: the shipped texture and its image under a known affine, rounded to 8 bits. Starts are those of matching that
follows a surface (near by, with the neighbour's affine) and those of the published experiments (N(0, 1.5) and N(0, 0.5) px off, no
affine). OpenCV's pyramidal Lucas-Kanade, two unknowns and no precision, tracks the same points with the same window in that run.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.matching.published_recipe import published
from benchmarks.measured_run import ROOT
from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import match_points, prepare

AFFINE = np.array([[0.97, -0.03], [0.02, 1.03]])
SHIFT = np.array([3.3, -4.7])
WINDOWS = (7, 15, 21, 31)
MARGIN, STEP = 60, 7
RECIPES = {
    "recommended, bilinear": lambda window: LeastSquaresMatching(window=window, interpolation="bilinear"),
    "recommended, bicubic": lambda window: LeastSquaresMatching(window=window),
    "recommended, ellipse": lambda window: LeastSquaresMatching(window=window, shape=Ellipse()),
    "published, square": published,
    "published, ellipse": lambda window: published(window, Ellipse()),
}


@dataclass(frozen=True)
class Trial:
    """Two images, points (N, 2) of the left one and their true places in the right one."""

    left: np.ndarray
    right: np.ndarray
    points: np.ndarray
    truth: np.ndarray


@dataclass(frozen=True)
class Starts:
    """Where matching begins: places (N, 2) and affines (N, 4)."""

    places: np.ndarray
    affine: np.ndarray


def trial() -> Trial:
    """The shipped texture, and what a camera sees that turns it by AFFINE and SHIFT."""
    texture = cv2.imread(str(ROOT / "tasks" / "simulation" / "textures" / "village.jpg"), cv2.IMREAD_GRAYSCALE)
    texture = np.ascontiguousarray(texture[:1600, :1600]).astype(np.float32)
    warped = cv2.warpAffine(texture, np.column_stack([AFFINE, SHIFT]), texture.shape[::-1], flags=cv2.INTER_CUBIC)
    left, right = (np.clip(np.rint(image), 1, 255).astype(np.uint8) for image in (texture, warped))
    col, row = np.meshgrid(*(np.arange(MARGIN, side - MARGIN, STEP, dtype=float) for side in texture.shape[::-1]))
    points = np.column_stack([col.ravel(), row.ravel()])
    truth = points @ AFFINE.T + SHIFT
    inside = (truth > MARGIN).all(axis=1) & (truth < np.array(texture.shape[::-1]) - MARGIN).all(axis=1)
    return Trial(left, right, points[inside], truth[inside])


def starts_of(pair: Trial) -> dict[str, Starts]:
    """Good starts, and those of the published experiments."""
    random, count = np.random.default_rng(1), len(pair.points)
    near = Starts(pair.truth + random.normal(0, 0.01, (count, 2)), AFFINE.ravel() + random.normal(0, 0.002, (count, 4)))
    far = Starts(pair.truth + random.normal(0, 1, (count, 2)) * (1.5, 0.5), np.tile([1.0, 0.0, 0.0, 1.0], (count, 1)))
    return {"near": near, "far": far}


def least_seconds(action: Callable[[], object]) -> float:
    """CPU-seconds of the fastest of three runs."""
    action()
    seconds = []
    for _ in range(3):
        began = time.process_time()
        action()
        seconds.append(time.process_time() - began)
    return min(seconds)


def matching(pair: Trial, starts: Starts, settings: LeastSquaresMatching) -> str:
    """Thousand points per CPU-second, matched share, median error."""
    images = prepare(pair.left, settings), prepare(pair.right, settings)
    found = match_points(*images, pair.points, starts.places, settings, starts.affine)
    seconds = least_seconds(lambda: match_points(*images, pair.points, starts.places, settings, starts.affine))
    error = np.hypot(*(found.position - pair.truth)[found.converged].T)
    return _cells(len(pair.points) / seconds, found.converged.mean(), float(np.median(error)))


def lucas_kanade(pair: Trial, starts: Starts, window: int) -> str:
    """The same of OpenCV's tracker, on one level, from the same places."""
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.02)
    points, places = pair.points.astype(np.float32)[:, None], starts.places.astype(np.float32)[:, None]

    def track() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return cv2.calcOpticalFlowPyrLK(
            pair.left,
            pair.right,
            points,
            places.copy(),
            winSize=(window, window),
            maxLevel=0,
            criteria=criteria,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )

    found, status, _ = track()
    error = np.hypot(*(found[:, 0] - pair.truth)[status.ravel() == 1].T)
    return _cells(len(points) / least_seconds(track), status.mean(), float(np.median(error)))


def _cells(speed: float, share: float, error: float) -> str:
    return f"{speed / 1e3:.0f} k | {100 * share:.1f} | {error:.3f}"


def speed_table() -> str:
    """The table as Markdown."""
    cv2.setNumThreads(1)
    pair = trial()
    lines = ["| window | method | starts | points / CPU-s | matched % | median error px |", "| --- | --- | --- | --- | --- | --- |"]
    for window in WINDOWS:
        for name, starts in starts_of(pair).items():
            for recipe, make in RECIPES.items():
                lines.append(f"| {window} | {recipe} | {name} | {matching(pair, starts, make(window))} |")
            lines.append(f"| {window} | OpenCV Lucas-Kanade (2 unknowns) | {name} | {lucas_kanade(pair, starts, window)} |")
    return "\n".join(lines)


def main(words: list[str]) -> None:
    """Measure and write benchmarks/results/matching_speed.md."""
    page = f"# Speed of least-squares matching\n\n{' '.join(__doc__.split(chr(10) + chr(10), 1)[1].split())}\n\n{speed_table()}\n"
    write_page("matching_speed", words, page)
