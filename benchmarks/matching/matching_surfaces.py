"""Dense surfaces of the synthetic pair and of real stereo pairs: the strategies and their peers, on the same nodes in one run.

Source: methods/measured.md (dense surface), matching_and_dsm_check.md table 4.12; Middlebury stereo data 2003 and 2014.
"""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.matching.dissertation_pair import CLEAN, NOISY, GroundTexture, PairCrop, check_points, pair_crop
from benchmarks.matching.dissertation_surface import PublishedPhoto, intersected, surface_points, true_matches
from benchmarks.matching.matching_experiment import PIXEL_HEIGHT, score, window_around
from benchmarks.matching.matching_peers import densification, semi_global_opencv
from benchmarks.matching.matching_published import EXTRACTION
from benchmarks.matching.matching_windows import SHAPES
from benchmarks.matching.published_recipe import published
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.dense.blocks import DenseMatching
from orthomill.tasks.matching.least_squares.matching import Matches
from orthomill.tasks.matching.strategies.coarse_to_fine import PyramidMatching, SearchRange, match_pyramid
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.region_growing import RegionGrowing, Seeds, found_seeds, grow

DENSE_WINDOW, QUICK_WINDOW = Window(3900, 6000, 3072, 3072), Window(4600, 7000, 560, 560)
PART_WINDOW = Window(3000, 4700, 4000, 5800)
_MARGIN, SEARCH, STEP = 36, 20, 4
_PYRAMID = PyramidMatching()
FAST = _PYRAMID.model_copy(update={"fine": _PYRAMID.fine.model_copy(update={"window": 13, "stop": 0.1})})
"""The pyramid with a smaller window, and one iteration where the start is good."""
GROWING = RegionGrowing(levels=1, matching=_PYRAMID.fine)


@dataclass(frozen=True, eq=False)
class Surface:
    """What a method gave for nodes: right columns (N,) px, NaN where nothing, and the CPU time that it took, s."""

    columns: np.ndarray
    seconds: float


def timed(work: Callable[[], np.ndarray]) -> Surface:
    """Right columns, and the CPU time of the fastest of three calls after one that may compile."""
    columns = work()
    seconds = []
    for _ in range(3):
        started = time.process_time()
        work()
        seconds.append(time.process_time() - started)
    return Surface(columns, min(seconds))


def parts_of(crop: PairCrop, unit: int) -> tuple[ImagePart, ImagePart]:
    """Both images cut so that they begin at multiples of `unit`."""
    parts = []
    for image, origin in ((crop.left, crop.left_origin), (crop.right, crop.right_origin)):
        col, row = (-value % unit for value in origin)
        parts.append(ImagePart(np.ascontiguousarray(image[row:, col:]), origin[0] + col, origin[1] + row))
    return parts[0], parts[1]


def search_of(points: np.ndarray) -> SearchRange:
    """What a method that knows the terrain roughly has to search for left points (N, 2) of the pair."""
    offsets = true_matches(points)[:, 0] - points[:, 0]
    return SearchRange(float(offsets.min()) - SEARCH, float(offsets.max()) + SEARCH, -SEARCH / 2, SEARCH / 2)


def synthetic_methods(crop: PairCrop, grid: NodeGrid) -> dict[str, Callable[[], np.ndarray]]:
    """Functions that match the nodes of a grid and return their right columns."""
    left, right = parts_of(crop, 2**_PYRAMID.levels)
    points = grid.points()
    search = search_of(points)
    in_left = (points - crop.left_origin).astype(int)

    def sgbm() -> np.ndarray:
        apart = crop.left_origin[0] - crop.right_origin[0]
        found = semi_global_opencv(
            crop.left, crop.right[crop.left_origin[1] - crop.right_origin[1] :], -search.col_high - apart, -search.col_low - apart
        )
        return points[:, 0] - (found[in_left[:, 1], in_left[:, 0]] + apart)

    def growing() -> np.ndarray:
        return grow(left, right, grid, found_seeds(left, right, grid, search, GROWING, _PYRAMID), GROWING).col

    return {
        "pyramid, window 15": lambda: match_pyramid(left, right, grid, search, _PYRAMID).col,
        "pyramid, window 13, stop 0.1 px": lambda: match_pyramid(left, right, grid, search, FAST).col,
        "region growing, seeds found": growing,
        "cv2.StereoSGBM, 3-way, block 5": sgbm,
    }


def dense_page(texture: GroundTexture, window: Window) -> list[str]:
    """Nodes 4 px apart on a part of the pair, end to end from 8-bit images."""
    lines = [
        "| method | pair | nodes | nodes per CPU-second | complete % | beyond 0.21 m % | RMS Z of all m | median px |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for pair, radiometry in (("clean", CLEAN), ("noise", NOISY)):
        crop = pair_crop(texture, window, _MARGIN, radiometry)
        grid = NodeGrid.within(ImagePart(crop.left, *crop.left_origin), STEP, _MARGIN)
        truth = true_matches(grid.points())
        for name, work in synthetic_methods(crop, grid).items():
            found = timed(work)
            error = np.abs(found.columns - truth[:, 0])
            known = np.isfinite(error)
            height = error[known] * PIXEL_HEIGHT
            lines.append(
                f"| {name} | {pair} | {len(truth)} | {len(truth) / found.seconds:,.0f} | {100 * known.mean():.2f} | "
                f"{100 * (height > 0.21).mean():.4f} | {np.sqrt((height**2).mean()):.4f} | {np.median(error[known]):.3f} |"
            )
    return lines


def extraction_page(texture: GroundTexture, part: Window | None = None) -> list[str]:
    """Table 4.12: the whole overlap (or a part), nodes 30 px apart, grown from three rough seeds as one region."""
    window = window_around(check_points(110.4, 26), _MARGIN) if part is None else part
    crop = pair_crop(texture, window, 64)
    left, right = parts_of(crop, 2**_PYRAMID.levels)
    grid = NodeGrid.within(left, 30, 30)
    points = grid.points()
    ground = surface_points(points, PublishedPhoto.LEFT)
    seeds = points[[len(points) * part // 10 for part in (2, 5, 8)]]
    rough = Seeds(seeds, true_matches(seeds) + np.array([1.0, -0.5]))
    search = search_of(points)
    recipes = {name: RegionGrowing(region=0, matching=published(27, shape)) for name, shape in SHAPES.items()}
    lines = [
        "| strategy | nodes | converged | y-parallax < 0.5 px % | correct of converged %, published | RMS Z m, published |",
        "| --- | --- | --- | --- | --- | --- |",
    ]

    def line(name: str, found: Matches, printed: tuple[float, float] | None) -> str:
        errors = intersected(found.reference, found.position) - ground
        known = found.converged
        beyond = np.abs(errors[known, 2]) > 0.21
        parallax = np.abs(found.row - found.reference[:, 1])[known] < 0.5
        old = ("-", "-") if printed is None else printed
        return (
            f"| {name} | {len(points)} | {known.sum()} | {100 * parallax.mean():.2f} | "
            f"{100 - 100 * beyond.mean():.2f} / {old[0]} | {score(errors).rms[2]:.4f} / {old[1]} |"
        )

    for name, settings in recipes.items():
        lines.append(line(f"published recipe 27, {name}, growing", grow(left, right, grid, rough, settings), EXTRACTION[name]))
    lines.append(line("region growing", grow(left, right, grid, rough, RegionGrowing(region=0)), None))
    found = match_pyramid(left, right, grid, search, _PYRAMID)
    lost = Counter(Outcome(code).sentence for code in found.outcome[~found.converged])
    reasons = "; ".join(f"{number} nodes: {sentence}" for sentence, number in lost.most_common())
    return [*lines, line("pyramid", found, None), "", f"What the pyramid does not return: {reasons or 'nothing'}."]


@dataclass(frozen=True, eq=False)
class StereoPair:
    """A rectified pair of grey images with true parallaxes, NaN where unknown."""

    name: str
    left: np.ndarray
    right: np.ndarray
    truth: np.ndarray


def cones(folder: Path) -> StereoPair | None:
    """Middlebury 2003 Cones, quarter size; None where it is absent."""
    if not (folder / "disp2.pgm").is_file():
        return None
    left, right, truth = (cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE) for name in ("im2.png", "im6.png", "disp2.pgm"))
    return StereoPair("Cones", left, right, np.where(truth > 0, truth / 4.0, np.nan))


def motorcycle(folder: Path) -> StereoPair | None:
    """Middlebury 2014 Motorcycle as scikit-image ships it (skimage/data); None where it is absent."""
    if not (folder / "motorcycle_disp.npz").is_file():
        return None
    left, right = (cv2.imread(str(folder / f"motorcycle_{side}.png"), cv2.IMREAD_GRAYSCALE) for side in ("left", "right"))
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"].astype(np.float64)
    return StereoPair("Motorcycle", left, right, np.where(np.isfinite(truth) & (truth > 0), truth, np.nan))


def real_page(pairs: list[StereoPair]) -> list[str]:
    """Accepted nodes of real pairs, 2 px apart: the strategies, the pipeline's densification, and SGBM."""
    lines = [
        "| pair | method | accepted of nodes with truth % | median px | beyond 1 px % | CPU s |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for pair in pairs:
        low, high = float(np.floor(np.nanmin(pair.truth))) - 4, float(np.ceil(np.nanmax(pair.truth))) + 4
        truth = pair.truth[::2, ::2]
        for name, work in real_methods(pair, low, high).items():
            found = timed(work)
            error = np.abs(found.columns[: truth.shape[0], : truth.shape[1]] - truth)[np.isfinite(truth)]
            known = error[np.isfinite(error)]
            lines.append(
                f"| {pair.name} | {name} | {100 * known.size / error.size:.1f} | {np.median(known):.3f} | "
                f"{100 * (known > 1.0).mean():.2f} | {found.seconds:.2f} |"
            )
    return lines


def real_methods(pair: StereoPair, low: float, high: float) -> dict[str, Callable[[], np.ndarray]]:
    """Functions that give parallaxes (rows, cols) of the nodes 2 px apart."""
    left, right = ImagePart(pair.left), ImagePart(pair.right)
    grid = NodeGrid(0, 0, *(-(-side // 2) for side in pair.left.shape), 2)
    search = SearchRange(-high, -low, -1.0, 1.0)
    small = PyramidMatching(
        levels=3,
        coarse_step=2,
        wide_window=15,
        neighbour_tolerance=0.5,
        min_neighbours=4,
        fine=_PYRAMID.fine.model_copy(update={"window": 11, "min_correlation": 0.8}),
    )
    growing = RegionGrowing(
        levels=1, region=16, min_neighbours=4, neighbour_tolerance=0.5, matching=small.fine.model_copy(update={"max_shift": 1.5})
    )

    def parallaxes(found: Matches) -> np.ndarray:
        return (grid.points()[:, 0] - found.col).reshape(grid.shape)

    return {
        "pyramid, window 11": lambda: parallaxes(match_pyramid(left, right, grid, search, small)),
        "region growing, seeds found": lambda: parallaxes(
            grow(left, right, grid, found_seeds(left, right, grid, search, growing, small), growing)
        ),
        "densification of the pipeline": lambda: densification(pair.left, pair.right, low, high, DenseMatching()),
        "cv2.StereoSGBM, its tests on": lambda: semi_global_opencv(pair.left, pair.right, low, high, True)[::2, ::2],
        "cv2.StereoSGBM, every value": lambda: semi_global_opencv(pair.left, pair.right, low, high)[::2, ::2],
    }
