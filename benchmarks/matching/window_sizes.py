"""What choosing a matching window costs, compared with the matching that it serves: microseconds of CPU for each point.

Uses a photograph of the project brighton; every figure is the least of several repetitions,
because the machine may have other work.
"""

import time
from collections.abc import Callable

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT
from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.radiometry import grey_bytes
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import match_points
from orthomill.tasks.matching.points.correlation import correlate
from orthomill.tasks.matching.points.interest_points import FoerstnerPoints, interest_points
from orthomill.tasks.matching.points.point_settings import HarrisPoints, TemplateCorrelation
from orthomill.tasks.matching.windows.calibration import LIMITS, calibrated, last_limits
from orthomill.tasks.matching.windows.size_map import size_map
from orthomill.tasks.matching.windows.sizes import grey_levels, window_sizes
from orthomill.tasks.matching.windows.window_settings import CombinedWindow, EntropyWindow, FoerstnerWindow, StatisticalWindow

PHOTO = ROOT / "workflows" / "photographs" / "brighton" / "DJI_0018.JPG"
POINTS, REPETITIONS, SHARE = 20_000, 5, 0.95
METHODS = (StatisticalWindow(), EntropyWindow(), FoerstnerWindow(), CombinedWindow())
SEARCHES = (41, 101, 201, 401)


def cpu_seconds(work: Callable[[], object]) -> float:
    """Least CPU time of several repetitions; the first, which may compile, does not count."""
    work()
    seconds = []
    for _ in range(REPETITIONS):
        started = time.process_time()
        work()
        seconds.append(time.process_time() - started)
    return min(seconds)


def photograph() -> np.ndarray:
    """(H, W) uint8"""
    header = read_header(PHOTO)
    return grey_bytes(read_pixels(PHOTO, Window(0, 0, header.height, header.width)))


def sizer_table(grey: np.ndarray, points: np.ndarray) -> list[str]:
    """Cost of all sizes and of the choice, beside least-squares matching of the same points."""
    image, micro = grey_levels(grey), 1e6 / len(points)
    bright = np.maximum(grey, 1)
    matching = cpu_seconds(lambda: match_points(bright, bright, points, points + 0.4, LeastSquaresMatching())) * micro
    lines = [
        "| method | all 15 sizes, µs | the choice, µs | the same, share of matching | points with a window, % |",
        "| --- | --- | --- | --- | --- |",
    ]
    for sizing in METHODS:
        every = cpu_seconds(lambda sizing=sizing: last_limits(image, points, sizing)) * micro
        choice = cpu_seconds(lambda sizing=sizing: window_sizes(image, points, sizing)) * micro
        share = 100 * window_sizes(image, points, sizing).assigned.mean()
        lines.append(f"| {sizing.kind} | {every:.1f} | {choice:.1f} | {choice / matching:.2f} | {share:.1f} |")
    return [*lines, "", f"Least-squares matching of the same points, 21 x 21, default settings: {matching:.1f} µs for each point."]


def calibration_table(grey: np.ndarray, points: np.ndarray) -> list[str]:
    """The limits at which a share of the points gets a window, and the share that gets one."""
    image = grey_levels(grey)
    lines = [f"| method | limit for {100 * SHARE:g} % | share reached, % |", "| --- | --- | --- |"]
    for sizing in METHODS[:3]:
        found = calibrated(sizing, last_limits(image, points, sizing), SHARE)
        name = LIMITS[type(sizing)]
        reached = 100 * window_sizes(image, points, found.sizing).assigned.mean()
        lines.append(f"| {sizing.kind} | {name} {getattr(found.sizing, name):.4g} | {reached:.2f} |")
    return lines


def map_lines(grey: np.ndarray) -> list[str]:
    """Cost of a map of a whole photograph."""
    image, whole = grey_levels(grey), Window(0, 0, *grey.shape)
    lines = ["| method | µs for each pixel |", "| --- | --- |"]
    for sizing in METHODS:
        started = time.process_time()
        size_map(image, whole, sizing)
        lines.append(f"| {sizing.kind} | {(time.process_time() - started) * 1e6 / grey.size:.2f} |")
    return lines


def point_lines(grey: np.ndarray, points: np.ndarray) -> list[str]:
    """Cost of interest points and of correlation."""
    bright = np.maximum(grey, 1)
    lines = []
    for detector in (HarrisPoints(), FoerstnerPoints()):
        seconds = cpu_seconds(lambda detector=detector: interest_points(bright, detector))
        found = len(interest_points(bright, detector))
        lines.append(f"- {detector.kind}: {seconds * 1e9 / grey.size:.0f} ns for each pixel, {found} points")
    some = points[:100]
    for search in SEARCHES:
        seconds = cpu_seconds(lambda search=search: correlate(bright, bright, some, some, TemplateCorrelation(search=search)))
        each = f"{seconds * 1e3 / len(some):.2f} ms for each point"
        lines.append(f"- correlation 21 x 21 in {search} x {search} px, there and back: {each}")
    return lines


def main(words: list[str]) -> None:
    """Measure and write the page."""
    grey, rng = photograph(), np.random.default_rng(0)
    rows, cols = grey.shape
    points = np.column_stack([rng.uniform(30, cols - 30, POINTS), rng.uniform(30, rows - 30, POINTS)])
    lines = [
        "# What a matching window costs",
        "",
        f"One thread, CPU time; {POINTS} points of a photograph of {cols} x {rows} px ({PHOTO.stem}).",
        "",
        "## The sizers",
        "",
        "All sizes: 7 x 7 to 35 x 35, whatever is accepted. The choice: default limits, large windows where small ones fail.",
        "",
        *sizer_table(grey, points),
        "",
        "## Calibrated limits",
        "",
        *calibration_table(grey, points),
        "",
        "## Maps of whole photographs",
        "",
        *map_lines(grey),
        "",
        "## Interest points and correlation",
        "",
        *point_lines(grey, points),
        "",
    ]
    write_page("window_sizes", words, "\n".join(lines))
