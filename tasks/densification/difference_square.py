"""One square of the block on which pairs that share no photograph are compared: their heights in the same cells."""

from collections.abc import Iterator

import numpy as np

from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import Window
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow, completed
from orthomill.tasks.densification.fusion import fuse
from orthomill.tasks.densification.ground_intersection import nodes_on_ground
from orthomill.tasks.densification.height_differences import EVEN_REACH
from orthomill.tasks.densification.height_stack import REACH as STACK_REACH
from orthomill.tasks.densification.precision.matched_ground import GROUND_REACH, matched_ground
from orthomill.tasks.densification.precision.pair_differences import MatchingDifferences, pair_differences
from orthomill.tasks.densification.surface_tile import PairPiece, SurfaceRules, SurfaceTile, empty_stack, gridded, surface_scratch

REACH = STACK_REACH + max(EVEN_REACH, GROUND_REACH) + 1
"""cells around a square that influence what is counted in it"""
_MATCHED = (Provenance.ONE_PAIR, Provenance.AGREED, Provenance.DISPUTED)


def square_scratch(pieces: tuple[PairPiece, ...], work: Window) -> int:
    """Working memory of `square_differences`, bytes."""
    # Beside what a tile of the surface takes, heights (float64) and standard errors (float32) of every pair.
    return surface_scratch(pieces, work) + array_bytes(12, len(pieces), work)


def square_differences(
    tile: SurfaceTile,
    rules: SurfaceRules,
    height: np.ndarray,
    judgement: np.ndarray,
    confidence: np.ndarray,
    nodes: Iterator[np.ndarray],
) -> MatchingDifferences:
    """The counts of the cells `tile.window`. height, judgement, confidence: the volume over `tile.work`, see `VolumeWindow`; nodes:
    one array (rows, cols, 3) float32 per piece, in their order."""
    volume, cell = VolumeWindow(height, judgement, confidence), tile.surface.grid.cell
    stack = empty_stack(volume, rules, cell)
    row, col = np.indices(tile.work.shape)
    heights, sigmas, photographs = [], [], []
    for piece, array in zip(tile.pieces, nodes, strict=True):
        found = gridded(nodes_on_ground(piece.pair, array, piece.nodes, piece.step), piece, tile, rules.gridding)
        stack.add(found)
        near = np.isfinite(found.height) & stack.near(row, col, found.height)
        heights.append(np.where(near, found.height, np.nan))
        sigmas.append(np.where(near, found.sigma, np.nan))
        photographs.append(frozenset((piece.pair.left, piece.pair.right)))
    cells = completed(fuse(stack, cell, rules.fusion), volume, cell)
    judged = np.isin(cells.provenance, _MATCHED)
    judged &= _within(tile)
    return pair_differences(np.array(heights), np.array(sigmas), photographs, matched_ground(cells, tile.step, cell), judged)


def _within(tile: SurfaceTile) -> np.ndarray:
    """(rows, cols) bool: the cells of `tile.work` that are its own."""
    own = np.zeros(tile.work.shape, bool)
    own[tile.window.within(tile.work).slices] = True
    return own
