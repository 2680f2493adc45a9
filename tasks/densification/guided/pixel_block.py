"""The last step of guided densification: every pixel of a block that has enough texture, guided by the densest model.

A pixel whose template has little entropy is left out: on a blank roof a high correlation may well be wrong.

Source: Karfis 2009, section 7.5 (sources/epipolar.md#per-pixel), check 21.
"""

from collections.abc import Iterator

import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.densification.guided.point_block import GuidedBlock, parallax_sigmas, parallaxes, right_columns
from orthomill.tasks.densification.matching_block import MatchedBlock, matching_statistics
from orthomill.tasks.densification.settings.guided_matching import Guided, Patch
from orthomill.tasks.geometry.normal_case import intersect_pair
from orthomill.tasks.matching.guided.band_correlation import band_places
from orthomill.tasks.matching.guided.column_interval import GuidePosts, parallax_intervals
from orthomill.tasks.matching.smoothing import with_gaps
from orthomill.tasks.matching.strategies.node_grid import ImagePart
from orthomill.tasks.matching.windows.measures import WindowGrowth, border_rooms, data_rooms, entropy
from orthomill.tasks.matching.windows.sizes import GreyLevels, grey_levels

AT_ONCE = 1 << 16
"""nodes that are matched at a time"""


def match_every_pixel(
    block: GuidedBlock,
    settings: Guided,
    left: np.ndarray | None = None,
    right: np.ndarray | None = None,
    guide: np.ndarray | None = None,
) -> MatchedBlock:
    """The nodes of a block. left, right: uint8, the windows of `block.part`; guide (rows, cols, 4): the posts over it."""
    shape = block.part.nodes.shape
    nodes, outcome = np.full((*shape, 3), np.nan, np.float32), np.full(shape, Outcome.OUTSIDE, np.uint8)
    if left is not None and right is not None and guide is not None:
        images = [
            ImagePart(with_gaps(pixels), at.col, at.row) for pixels, at in ((left, block.part.left), (right, block.part.right))
        ]
        levels = grey_levels(left, left > 0)
        posts = GuidePosts.of(block.guide, block.posts, guide)
        for rows in _bands(shape):
            nodes[rows], outcome[rows] = _matched(block, settings, images[0], images[1], levels, posts, rows)
    return MatchedBlock(nodes, outcome, matching_statistics(nodes, outcome, float("nan")))


def _bands(shape: tuple[int, int]) -> Iterator[slice]:
    """Rows of nodes that are matched at a time."""
    height = max(1, AT_ONCE // max(shape[1], 1))
    return (slice(first, min(first + height, shape[0])) for first in range(0, shape[0], height))


def _matched(
    block: GuidedBlock, settings: Guided, left: ImagePart, right: ImagePart, levels: GreyLevels, posts: GuidePosts, rows: slice
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (rows, cols, 3) and outcomes (rows, cols) of some rows of a block."""
    part, rules = block.part, settings.pixels
    row, col = np.mgrid[rows, : part.nodes.width]
    full = np.column_stack([(part.nodes.col + col).ravel(), (part.nodes.row + row).ravel()]) * part.step
    at = full - left.origin.astype(np.int64)
    rich = entropy_bits(levels, at, rules.correlation.half) > rules.min_entropy
    intervals = np.full((len(full), 3), np.nan)
    intervals[rich] = parallax_intervals(block.pair, full[rich].astype(np.float64), posts, settings.interval, block.side)
    wanted = _in_patches(block, full, intervals[:, 1], rules.patches)
    intervals[~wanted] = np.nan
    columns = right_columns(part, full.astype(np.float64), right, intervals, 1, settings.interval.margin)
    found = band_places(
        left.pixels, right.pixels, at, columns, left.row - right.row, settings.beside(block.pair, 0), rules.correlation
    )
    outcome = np.where(rich, found.outcome, np.where(found.outcome == Outcome.OUTSIDE, Outcome.LOW_TEXTURE, found.outcome))
    outcome = np.where(rich & ~wanted, Outcome.NOT_TRIED, outcome)
    outcome = np.where(left.pixels[at[:, 1], at[:, 0]] > 0, outcome, Outcome.OUTSIDE).astype(np.uint8)
    sigma = parallax_sigmas(found, 1, rules.correlation.template, settings)
    values = np.column_stack([parallaxes(part, full, found, right, 1), sigma, found.correlation])
    values[outcome != Outcome.CONVERGED] = np.nan
    shape = row.shape
    return values.reshape(*shape, 3).astype(np.float32), outcome.reshape(shape)


def entropy_bits(levels: GreyLevels, pixels: np.ndarray, half: int) -> np.ndarray:
    """(N,) entropy of the grey levels of the windows about pixels (N, 2), bits; NaN where a window is not complete."""
    rooms = border_rooms(levels.levels.shape, pixels, half)
    if not levels.complete:
        rooms = data_rooms(levels.levels, pixels, rooms)
    return entropy(levels.levels, WindowGrowth(pixels, rooms, half, half))[:, 1] / np.log(2.0)


def _in_patches(block: GuidedBlock, full: np.ndarray, parallax: np.ndarray, patches: tuple[Patch, ...]) -> np.ndarray:
    """(N,) bool: pixels whose place on the guide lies in one of the patches."""
    if not patches:
        return np.ones(len(full), bool)
    x, y, _ = intersect_pair(block.pair, full.astype(np.float64), parallax).T
    inside = np.zeros(len(full), bool)
    for west, south, east, north in patches:
        inside |= (x >= west) & (x <= east) & (y >= south) & (y <= north)
    return inside
