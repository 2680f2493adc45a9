"""A tile of the surface from vertical lines: what was accepted, without spikes, with the standard errors and estimates of any
other.

How clearly a correlation passes its limit takes the place of how clearly a height beats its rivals.
"""

import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.surface import Provenance, SurfacePoints
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.filling import without
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.spike_filter import spikes
from orthomill.tasks.densification.surface_tile import SurfaceCells, SurfaceRules, SurfaceTile, finished_cells, surface_cells
from orthomill.tasks.densification.volume.quality import Judgement


def make_line_surface(
    tile: SurfaceTile, rules: SurfaceRules, nodes: np.ndarray, photographs: np.ndarray, outcome: np.ndarray
) -> SurfaceCells:
    """The cells of a tile; nodes (rows, cols, 4), photographs and outcome (rows, cols) over `tile.work`, see `SolvedLines`."""
    found, volume = _measured(nodes, photographs, outcome), _standing(nodes)
    spiky = spikes(found.height, tile.surface.grid.cell, rules.spikes)
    cells, datum, statistics = finished_cells(without(found, spiky), volume, spiky, tile, rules)
    return surface_cells(cells, datum, statistics, _points(tile, cells, photographs))


def _measured(nodes: np.ndarray, photographs: np.ndarray, outcome: np.ndarray) -> FusedCells:
    accepted, paired = outcome == Outcome.CONVERGED, photographs == 2
    code = np.where(paired, np.uint8(Provenance.ONE_PAIR), np.uint8(Provenance.VOLUME))
    # A top that no parabola has is as uncertain as can be, but a number: NaN would stand for no height.
    sigma = np.where(accepted, np.minimum(nodes[..., 1], np.float32(1e3)), np.float32(np.nan))
    return FusedCells(
        np.where(accepted, nodes[..., 0], np.float32(np.nan)),
        sigma,
        (accepted & paired).astype(np.uint8),
        np.where(accepted, code, np.uint8(Provenance.EMPTY)),
    )


def _standing(nodes: np.ndarray) -> VolumeWindow:
    """A volume of no heights that says how clearly those of the lines were found."""
    volume = VolumeWindow.unknown(nodes.shape[:2])
    correlation, limit = np.abs(np.nan_to_num(nodes[..., 2])), np.nan_to_num(nodes[..., 3], nan=1.0)
    clear = np.clip((correlation - limit) / np.maximum(1.0 - limit, 1e-6), 0.0, 1.0)
    volume.judgement[..., Judgement.DISTINCTIVENESS] = np.rint(100.0 * clear)
    return volume


def _points(tile: SurfaceTile, cells: FusedCells, photographs: np.ndarray) -> SurfacePoints:
    """The measured cells as points: the node of a line is the middle of its cell."""
    measured = np.isin(cells.provenance, (Provenance.ONE_PAIR, Provenance.VOLUME))
    x, y = np.meshgrid(*tile.surface.grid.centres(tile.window))
    rays = photographs[tile.window.within(tile.work).slices][measured]
    return SurfacePoints(
        x=x[measured],
        y=y[measured],
        z=cells.height[measured].astype(np.float64),
        sigma=cells.precision[measured],
        rays=rays,
        code=cells.provenance[measured],
        source=np.zeros(len(rays), np.uint16),
    )
