"""Which files a large GeoTIFF is made of: parts that are encoded side by side, and the file that joins them."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from orthomill.pipeline.export.geotiff.cloud_layout import PART
from orthomill.schemas.job import Export
from orthomill.schemas.raster import RasterSpec, tiles_of

PARTS = "parts"
"""of a run: not among the products"""
COG_PART, COG_OF_PARTS = "cog part", "cog of parts"
"""formats of exports"""


def in_parts(export: Export, specs: Mapping[str, RasterSpec]) -> Iterator[Export]:
    """The exports that make a file from rasters of `specs`: itself where they are small or unknown, or it is no GeoTIFF."""
    first = specs.get(next(iter(export.rasters.values()), ""))
    if first is None or export.format != "cog" or max(first.full.shape) <= PART:
        yield export
        return
    item, files = f"{export.item}-parts", []
    for tile in tiles_of(first.shape, PART):
        files.append(f"{PARTS}/{export.path}/{tile.row}-{tile.col}.tif")
        yield replace(export, item=item, path=files[-1], format=COG_PART, window=tile.window, row=tile.row, col=tile.col)
    yield replace(export, format=COG_OF_PARTS, files=tuple(files))
