"""Which parts a large file is made of, that are encoded side by side, and the file that joins them.

Parts are copied into one file and go. Sheets, of rasters larger than the project's bound, are files that stay, and what joins them
is a virtual raster: nobody has to copy hundreds of gigabytes at the end of a run.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from orthomill.pipeline.export.geotiff.cloud_layout import PART
from orthomill.pipeline.storage.depots.folder import PARTS
from orthomill.pipeline.storage.depots.product_files import joined_path, sheet_folder
from orthomill.schemas.job import Export
from orthomill.schemas.raster import RasterSpec, Tile, tiles_of

COG_PART, COG_OF_PARTS, LAZ_PART, LAZ_OF_PARTS = "cog part", "cog of parts", "laz part", "laz of parts"
COG_SHEET, COG_OF_SHEETS = "cog sheet", "cog of sheets"
"""formats of exports"""
SHEET = 4 * PART
"""side of a sheet, px: a gigabyte of an orthoimage, half a minute of work; on the grid of parts, so that its overviews are those of
the whole raster"""


def joins_parts(export: Export) -> bool:
    """Whether it makes a file of parts, which nobody needs when it is there."""
    return export.format in (COG_OF_PARTS, LAZ_OF_PARTS)


def parts_of(path: str) -> str:
    """The folder of the parts of a file."""
    return f"{PARTS}/{path}"


def sheet_tiles(spec: RasterSpec) -> tuple[Tile, ...]:
    """The sheets of a raster, in the order of the files of what joins them."""
    return tuple(tiles_of(spec.shape, SHEET))


def in_parts(export: Export, specs: Mapping[str, RasterSpec], whole: float) -> Iterator[Export]:
    """The exports that make a file from rasters of `specs`: itself where they are small or unknown, or it has another format; in
    sheets where a GeoTIFF would hold more than `whole` bytes, not compressed."""
    first = specs.get(next(iter(export.rasters.values()), ""))
    # The points of tables are in files of their own where there are many.
    if first is None or export.tables or export.format not in ("cog", "laz"):
        yield export
    elif export.format == "cog" and _bytes_of(export, specs) > whole:
        yield from _divided(export, "sheet", sheet_folder(export.path), sheet_tiles(first), joined_path(export.path))
    elif max(first.full.shape) > PART:
        yield from _divided(export, "part", parts_of(export.path), tuple(tiles_of(first.shape, PART)), export.path)
    else:
        yield export


def _bytes_of(export: Export, specs: Mapping[str, RasterSpec]) -> int:
    return sum(spec.bytes_of(spec.full) for name in export.rasters.values() if (spec := specs.get(name)))


def _divided(export: Export, kind: str, folder: str, tiles: tuple[Tile, ...], whole: str) -> Iterator[Export]:
    """An export for each tile, and the one that joins their files in `whole`."""
    item, form, ending, files = f"{export.item}-{kind}s", f"{export.format} {kind}", export.path.rpartition(".")[2], []
    for tile in tiles:
        files.append(f"{folder}/{tile.row}-{tile.col}.{ending}")
        yield replace(export, item=item, path=files[-1], format=form, window=tile.window, row=tile.row, col=tile.col)
    yield replace(export, path=whole, format=f"{export.format} of {kind}s", files=tuple(files))
