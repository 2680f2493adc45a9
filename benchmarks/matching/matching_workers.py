"""Two workers against one: the dense surface of a part of the synthetic pair, strip by strip, in separate processes.

Wall times, so that the machine has to be idle; both are taken in one run, after a round that loads the kernels. A strip comes with
its halo, as a tile of the pipeline does; what one worker and two workers find is compared as well.
"""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from benchmarks.matching.dissertation_pair import CLEAN, GroundTexture, PairCrop, pair_crop
from benchmarks.matching.matching_surfaces import SEARCH, STEP, parts_of, search_of
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange, halo, match_pyramid
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching

_STRIPS, _ROUNDS = 4, 3
_PYRAMID = PyramidMatching()
Job = tuple[ImagePart, ImagePart, NodeGrid, SearchRange]
_received: list[Job] = []


def strips_of(crop: PairCrop) -> list[Job]:
    """What the jobs are given: strips of the left part with their halo, the right part, nodes and search range."""
    unit = 2**_PYRAMID.levels
    left, right = parts_of(crop, unit)
    whole = NodeGrid.within(left, STEP, 2 * SEARCH)
    search = search_of(whole.points())
    reach = -(-halo(_PYRAMID, STEP) // unit) * unit
    height = whole.rows // _STRIPS
    jobs = []
    for first in range(whole.row, whole.row + height * _STRIPS, height):
        top = max(left.row, (first * STEP - reach) // unit * unit)
        bottom = min(left.row + left.pixels.shape[0], (first + height) * STEP + reach)
        part = ImagePart(np.ascontiguousarray(left.pixels[top - left.row : bottom - left.row]), left.col, top)
        jobs.append((part, right, NodeGrid(first, whole.col, height, whole.cols, STEP), search))
    return jobs


def _receive(jobs: list[Job]) -> None:
    """In a worker: keep the images, so that they are not sent anew in every round."""
    _received[:] = jobs


def _matched(number: int) -> np.ndarray:
    return match_pyramid(*_received[number], _PYRAMID).col


def _timed(jobs: list[Job], workers: int) -> tuple[float, list[np.ndarray]]:
    """Least wall seconds of some rounds, and what was found."""
    with ProcessPoolExecutor(workers, get_context("spawn"), _receive, (jobs,)) as pool:
        found = list(pool.map(_matched, range(len(jobs))))
        seconds = []
        for _ in range(_ROUNDS):
            began = time.perf_counter()
            list(pool.map(_matched, range(len(jobs))))
            seconds.append(time.perf_counter() - began)
    return min(seconds), found


def workers_page(texture: GroundTexture, window: Window) -> list[str]:
    """One row for each number of workers up to the number of cores."""
    jobs = strips_of(pair_crop(texture, window, 3 * SEARCH, CLEAN))
    alone, expected = _timed(jobs, 1)
    lines = ["| workers | wall s | against one | same numbers |", "| --- | --- | --- | --- |", f"| 1 | {alone:.2f} | 1.00 | - |"]
    for workers in range(2, (os.cpu_count() or 1) + 1):
        seconds, found = _timed(jobs, workers)
        same = all(np.array_equal(a, b, equal_nan=True) for a, b in zip(expected, found, strict=True))
        lines.append(f"| {workers} | {seconds:.2f} | {alone / seconds:.2f} | {'yes' if same else 'NO'} |")
    return lines
