"""What an orthoimage or a surface of any program shows of itself: its pixel, gaps inside it, colours at the ends of their scale,
and how much of an area it covers."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from rasterio.errors import RasterioError

from orthomill.pipeline.storage.features.outline_files import read_outlines
from orthomill.pipeline.storage.map_files import opened_map
from orthomill.schemas.errors import WorkflowError

_OVERVIEW = 2048
"""px, longest side at which gaps are looked for"""


@dataclass(frozen=True)
class OrthoimageFacts:
    """pixel m; voids: share of the pixels inside its outline without colour, clipped: share of those with colour of which a band
    is at an end of its scale, %; crs as it is written in the file."""

    pixel: float
    voids: float
    clipped: float
    crs: str


def orthoimage_facts(path: Path) -> OrthoimageFacts:
    """Reads a file block by block. Raises WorkflowError where it is no georeferenced raster."""
    with _whole(path) as source:
        bands = list(range(1, min(source.count, 3) + 1))
        top = np.iinfo(source.dtypes[0]).max if np.issubdtype(np.dtype(source.dtypes[0]), np.integer) else np.inf
        clipped = coloured = 0
        for _, window in source.block_windows(1):
            there = source.dataset_mask(window=window) > 0
            values = source.read(bands, window=window)
            clipped += int((((values == 0) | (values >= top)).any(axis=0) & there).sum())
            coloured += int(there.sum())
        crs = source.crs.to_string() if source.crs else ""
        return OrthoimageFacts(abs(source.transform.a), _gaps(_filled(source)), 100.0 * clipped / max(coloured, 1), crs)


def gaps_of(path: Path) -> float:
    """Share of the cells inside the outline of a surface that have no height, %. Raises WorkflowError."""
    with _whole(path, "EPSG:4326") as source:
        return _gaps(_filled(source))


def covered_share(path: Path, area: Path) -> float:
    """Share of the polygons of a file in which a raster has values, %, by places a cell of its overview apart. Raises
    WorkflowError."""
    with _whole(path, "EPSG:4326") as source:
        filled, system = _filled(source), source.crs.to_wkt() if source.crs else "EPSG:4326"
        step = source.width / filled.shape[1], source.height / filled.shape[0]
        asked = covered = 0
        inverse = ~source.transform
        for outline in read_outlines(area, system):
            west, south, east, north = outline.bounds
            # At least a hundred places along a side, however small the polygon is beside the raster.
            wide = min(abs(source.transform.a) * step[0], (east - west) / 100)
            high = min(abs(source.transform.e) * step[1], (north - south) / 100)
            for y in np.arange(south + high / 2, north, high):
                x = np.arange(west + wide / 2, east, wide)
                x = x[outline.contains(x, np.full(len(x), y))]
                col = np.floor((inverse.a * x + inverse.b * y + inverse.c) / step[0]).astype(int)
                row = np.floor((inverse.d * x + inverse.e * y + inverse.f) / step[1]).astype(int)
                inside = (col >= 0) & (col < filled.shape[1]) & (row >= 0) & (row < filled.shape[0])
                asked += len(x)
                covered += int(filled[row[inside], col[inside]].sum())
        return 100.0 * covered / asked if asked else 0.0


@contextmanager
def _whole(path: Path, system: str | None = None) -> Iterator[rasterio.DatasetReader]:
    """A raster that is read from end to end; damage in its middle is found, and told as a sentence."""
    with opened_map(path, system) as source:
        try:
            yield source
        except RasterioError:
            raise WorkflowError(f"{path} is damaged: parts of it cannot be read; write or fetch it again.") from None


def _filled(source: rasterio.DatasetReader) -> np.ndarray:
    """Where a raster has values, (rows, cols) bool, no larger than an overview."""
    scale = max(1, -(-max(source.width, source.height) // _OVERVIEW))
    shape = max(1, source.height // scale), max(1, source.width // scale)
    return np.asarray(source.dataset_mask(out_shape=shape) > 0)


def _gaps(filled: np.ndarray) -> float:
    """Share of what the outline surrounds that has no value, %."""
    from scipy.ndimage import binary_fill_holes

    inside = int(binary_fill_holes(filled).sum())
    return 100.0 * (inside - int(filled.sum())) / inside if inside else 100.0
