"""What an orthoimage of any program shows of itself: its pixel, gaps inside it, and colours at the ends of their scale."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orthomill.pipeline.storage.map_files import opened_map

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
    from scipy.ndimage import binary_fill_holes

    with opened_map(path) as source:
        scale = max(1, -(-max(source.width, source.height) // _OVERVIEW))
        shape = max(1, source.height // scale), max(1, source.width // scale)
        filled = source.dataset_mask(out_shape=shape) > 0
        outline = binary_fill_holes(filled)
        bands = list(range(1, min(source.count, 3) + 1))
        top = np.iinfo(source.dtypes[0]).max if np.issubdtype(np.dtype(source.dtypes[0]), np.integer) else np.inf
        clipped = coloured = 0
        for _, window in source.block_windows(1):
            there = source.dataset_mask(window=window) > 0
            values = source.read(bands, window=window)
            clipped += int((((values == 0) | (values >= top)).any(axis=0) & there).sum())
            coloured += int(there.sum())
        inside = int(outline.sum())
        voids = 100.0 * (inside - int(filled.sum())) / inside if inside else 100.0
        crs = source.crs.to_string() if source.crs else ""
        return OrthoimageFacts(abs(source.transform.a), voids, 100.0 * clipped / max(coloured, 1), crs)
