"""Which parts a large file is made of, that are encoded side by side, and the file that joins them."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from orthomill.pipeline.export.geotiff.cloud_layout import PART
from orthomill.pipeline.storage.depots.folder import PARTS
from orthomill.schemas.job import Export
from orthomill.schemas.raster import RasterSpec, tiles_of

COG_PART, COG_OF_PARTS, LAZ_PART, LAZ_OF_PARTS = "cog part", "cog of parts", "laz part", "laz of parts"
"""formats of exports"""


def joins_parts(export: Export) -> bool:
    """Whether it makes a file of parts, which nobody needs when it is there."""
    return export.format in (COG_OF_PARTS, LAZ_OF_PARTS)


def parts_of(path: str) -> str:
    """The folder of the parts of a file."""
    return f"{PARTS}/{path}"


def in_parts(export: Export, specs: Mapping[str, RasterSpec]) -> Iterator[Export]:
    """The exports that make a file from rasters of `specs`: itself where they are small or unknown, or it has another format."""
    first = specs.get(next(iter(export.rasters.values()), ""))
    # The points of tables are in files of their own where there are many.
    if first is None or export.tables or export.format not in ("cog", "laz") or max(first.full.shape) <= PART:
        yield export
        return
    item, form, ending, files = f"{export.item}-parts", f"{export.format} part", export.path.rpartition(".")[2], []
    for tile in tiles_of(first.shape, PART):
        files.append(f"{parts_of(export.path)}/{tile.row}-{tile.col}.{ending}")
        yield replace(export, item=item, path=files[-1], format=form, window=tile.window, row=tile.row, col=tile.col)
    yield replace(export, format=f"{export.format} of parts", files=tuple(files))
