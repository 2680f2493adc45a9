"""The numbers of the report: what tie points say of the rows of all pairs, and where photographs and footprints lie."""

from typing import NamedTuple

import numpy as np

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.observations import ImageResiduals
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.epipolar.parallax import RowResiduals, kept_ties, row_residuals, summary
from orthomill.tasks.geometry.normal_case import border_pixels
from orthomill.tasks.geometry.view import block_view

_EDGES = np.linspace(-2.0, 2.0, 41)
"""px: beyond 2 px nothing can be matched along rows: how far beyond does not matter, so the outermost classes collect it"""


class CheckedRows(NamedTuple):
    """Residual y-parallaxes of the tie points: by name of the pair, of all together, and their number by class (`middles`, px)."""

    pairs: dict[str, RowResiduals]
    whole: RowResiduals
    middles: tuple[float, ...]
    counts: tuple[float, ...]


def checked_rows(block: Block, pairs: EpipolarPairs, measured: ImageResiduals, photos: Photos) -> CheckedRows:
    """The y-parallaxes of the tie points that the adjustment kept."""
    ties = kept_ties(measured)
    residuals = {pair.name: row_residuals(pair, block, ties, photos.names) for pair in pairs.pairs}
    every = np.concatenate(list(residuals.values()))
    counts, _ = np.histogram(np.clip(every, _EDGES[0], _EDGES[-1]), _EDGES)
    middles = tuple(((_EDGES[:-1] + _EDGES[1:]) / 2).round(3).tolist())
    rows = {name: summary(values) for name, values in residuals.items()}
    return CheckedRows(rows, summary(every), middles, tuple(map(float, counts)))


def mean_base_height(pairs: EpipolarPairs) -> float:
    """Mean base over flying height."""
    return float(np.mean([pair.base_height for pair in pairs.pairs]))


def centres_and_footprints(block: Block) -> tuple[tuple[float, ...], tuple[float, ...], int]:
    """X and Y (m) of the projection centres and of points along the borders of the footprints; and how many are centres."""
    # Every fourth border point: the footprint stays recognisable and the chart of a large block stays small.
    mean = block.ground_mean
    corners = [block_view(block, name).at_height(border_pixels(block_view(block, name))[::4], mean) for name in block.names]
    points = np.vstack([[photo.centre for photo in block.photos], *corners])
    points = points[np.isfinite(points).all(axis=1)]
    x, y = points[:, 0].round(2).tolist(), points[:, 1].round(2).tolist()
    return tuple(x), tuple(y), len(block.names)
