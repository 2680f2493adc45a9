"""Dense surfaces of the synthetic pair and of real stereo pairs: the strategies and their peers, on the same nodes in one run.

Source: sources/measured.md#dense; Skarlatos (sources/matching.md#table-4-12); Middlebury stereo data 2003 and 2014.
"""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.matching.dissertation_pair import CLEAN, NOISY, GroundTexture, PairCrop, PairRadiometry, check_points, pair_crop
from benchmarks.matching.dissertation_surface import PublishedPhoto, intersected, surface_points, true_matches
from benchmarks.matching.matching_experiment import PIXEL_HEIGHT, score, window_around
from benchmarks.matching.matching_peers import semi_global_opencv
from benchmarks.matching.matching_published import EXTRACTION
from benchmarks.matching.matching_windows import SHAPES
from benchmarks.matching.published_recipe import published
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.pair_start import pair_start
from orthomill.tasks.matching.dense.pair_surface import PairSurface, ParallaxCode, hidden, match_pair, nodes_near
from orthomill.tasks.matching.least_squares.matching import Matches
from orthomill.tasks.matching.smoothing import with_gaps
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange, match_pyramid
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching
from orthomill.tasks.matching.strategies.region_growing import Seeds, found_seeds, grow

DENSE_WINDOW, QUICK_WINDOW = Window(3900, 6000, 3072, 3072), Window(4600, 7000, 560, 560)
PART_WINDOW = Window(3000, 4700, 4000, 5800)
_MARGIN, SEARCH, STEP = 36, 20, 4
_STAGE = 1024
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


def rectified(crop: PairCrop) -> tuple[np.ndarray, np.ndarray, int]:
    """Both images of a crop with the same rows, and what is added to their parallaxes to give those of the photographs."""
    first = crop.left_origin[1] - crop.right_origin[1]
    return crop.left, crop.right[first : first + len(crop.left)], crop.left_origin[0] - crop.right_origin[0]


def stage_lines(texture: GroundTexture, window: Window, pair: str, radiometry: PairRadiometry) -> list[str]:
    """The rows of the stage's own matcher, nodes 2 px apart, all that least squares returns: the pair alone gives the start; and
    near a start that is there, as the pairs of a project are matched near the heights of all photographs."""
    part = Window(window.row, window.col, min(window.height, _STAGE), min(window.width, _STAGE))
    crop = pair_crop(texture, part, _MARGIN, radiometry)
    left, right, apart = rectified(crop)
    inside = slice(_MARGIN, -_MARGIN, 2)
    rows, cols = (np.arange(side)[inside] for side in left.shape)
    points = np.column_stack([part.ravel() for part in np.meshgrid(cols, rows)]) + crop.left_origin
    truth = points[:, 0] - true_matches(points)[:, 0] - apart
    low, high = float(truth.min()) - SEARCH, float(truth.max()) + SEARCH

    def match() -> np.ndarray:
        found = match_pair(left, right, low, high)
        return np.where(found.outcome == Outcome.CONVERGED, found.parallax, np.nan)

    plain = with_gaps(left), with_gaps(right)
    start = pair_start(*plain, low, high)
    places = slice(_MARGIN // 2, _MARGIN // 2 + len(rows)), slice(_MARGIN // 2, _MARGIN // 2 + len(cols))
    lines = []
    for name, work in (
        ("as the stage runs it, nodes 2 px apart", match),
        ("the same near a start that is there", lambda: nodes_near(*plain, start, DenseMatching()).parallax),
    ):
        found = timed(work)
        error = np.abs(found.columns[places].ravel() - truth)
        lines.append(_dense_line(name, pair, found.columns.size, found.seconds, error))
    return lines


def _dense_line(name: str, pair: str, nodes: int, seconds: float, error: np.ndarray) -> str:
    known = np.isfinite(error)
    height = error[known] * PIXEL_HEIGHT
    return (
        f"| {name} | {pair} | {nodes} | {nodes / seconds:,.0f} | {100 * known.mean():.2f} | "
        f"{100 * (height > 0.21).mean():.4f} | {np.sqrt((height**2).mean()):.4f} | {np.median(error[known]):.3f} |"
    )


def dense_page(texture: GroundTexture, window: Window) -> list[str]:
    """Nodes 4 px apart on a part of the pair, end to end from 8-bit images; the stage's own on its first 1024 x 1024 px."""
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
            lines.append(_dense_line(name, pair, len(truth), found.seconds, np.abs(found.columns - truth[:, 0])))
        lines += stage_lines(texture, window, pair, radiometry)
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
    """A rectified pair of grey images with true parallaxes, NaN where unknown, in steps of `quantum` px."""

    name: str
    left: np.ndarray
    right: np.ndarray
    truth: np.ndarray
    quantum: float = 0.0


def cones(folder: Path) -> StereoPair | None:
    """Middlebury 2003 Cones, quarter size; None where it is absent."""
    if not (folder / "disp2.pgm").is_file():
        return None
    left, right, truth = (cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE) for name in ("im2.png", "im6.png", "disp2.pgm"))
    return StereoPair("Cones", left, right, np.where(truth > 0, truth / 4.0, np.nan), 0.25)


def motorcycle(folder: Path) -> StereoPair | None:
    """Middlebury 2014 Motorcycle as scikit-image ships it (skimage/data); None where it is absent."""
    if not (folder / "motorcycle_disp.npz").is_file():
        return None
    left, right = (cv2.imread(str(folder / f"motorcycle_{side}.png"), cv2.IMREAD_GRAYSCALE) for side in ("left", "right"))
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"].astype(np.float64)
    return StereoPair("Motorcycle", left, right, np.where(np.isfinite(truth) & (truth > 0), truth, np.nan))


def real_page(pairs: list[StereoPair]) -> list[str]:
    """Nodes of real pairs 2 px apart that both images show: the strategies, the stage's own matcher by code, and SGBM.

    The standard error of a parallax has that of the truth added, which is given in quarters of a pixel for Cones.
    """
    lines = [
        "| pair | method | complete % | within 1 px, of all % | median px | beyond 1 px % | error within 1 / 3 standard errors % "
        "| nodes per CPU-second |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for pair in pairs:
        low, high = float(np.floor(np.nanmin(pair.truth))) - 4, float(np.ceil(np.nanmax(pair.truth))) + 4
        for name, work in real_methods(pair, low, high).items():
            found = timed(work)
            speed = f"{found.columns.size / found.seconds:,.0f}"
            lines.append(f"| {pair.name} | {name} | {_real_line(pair, found.columns)} | - | {speed} |")
        surfaces: list[PairSurface] = []
        took = timed(lambda pair=pair, low=low, high=high, kept=surfaces: _kept(match_pair(pair.left, pair.right, low, high), kept))
        surface, speed = surfaces[-1], f"{took.columns.size / took.seconds:,.0f}"
        for name, chosen in (
            ("as the stage runs it, all codes", surface.code > ParallaxCode.EMPTY),
            ("measured by least squares", surface.code == ParallaxCode.MEASURED),
            ("by the volume alone", surface.code == ParallaxCode.VOLUME),
            ("estimated", surface.code == ParallaxCode.ESTIMATED),
        ):
            columns = np.where(chosen, surface.parallax, np.nan)
            shares = _within(pair, columns, surface.sigma)
            lines.append(f"| {pair.name} | {name} | {_real_line(pair, columns)} | {shares} | {speed} |")
    return lines


def _kept(surface: PairSurface, surfaces: list[PairSurface]) -> np.ndarray:
    surfaces.append(surface)
    return surface.parallax


def nodes_of_both(pair: StereoPair) -> np.ndarray:
    """(rows, cols) bool: nodes 2 px apart that both images show."""
    truth = pair.truth.astype(np.float32)
    return (np.isfinite(truth) & ~hidden(truth, pair.right.shape[1]))[::2, ::2]


def _real_line(pair: StereoPair, parallax: np.ndarray) -> str:
    """Cells of a row: complete, right of all, median and share beyond 1 px."""
    error = np.abs(parallax - pair.truth[::2, ::2])[nodes_of_both(pair)]
    known = error[np.isfinite(error)]
    return (
        f"{100 * known.size / error.size:.1f} | {100 * (known <= 1).sum() / error.size:.1f} | {np.median(known):.3f} | "
        f"{100 * (known > 1).mean():.2f}"
    )


def _within(pair: StereoPair, parallax: np.ndarray, sigma: np.ndarray) -> str:
    """Shares of the errors within one and three standard errors."""
    allowed = np.hypot(sigma, pair.quantum / np.sqrt(12.0))
    ratio = (np.abs(parallax - pair.truth[::2, ::2]) / allowed)[nodes_of_both(pair)]
    known = ratio[np.isfinite(ratio)]
    return f"{100 * (known <= 1).mean():.0f} / {100 * (known <= 3).mean():.1f}"


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
        "cv2.StereoSGBM, its tests on": lambda: semi_global_opencv(pair.left, pair.right, low, high, True)[::2, ::2],
        "cv2.StereoSGBM, every value": lambda: semi_global_opencv(pair.left, pair.right, low, high)[::2, ::2],
    }
