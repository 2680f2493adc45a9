"""A product of a run in another reference system, area or cell, read window by window.

The file of the product is warped by GDAL when a window is read, so that nothing but that window is in memory. Codes take the
nearest cell, heights and colours are interpolated, and averaged where cells become larger.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import rasterio
from pyproj import CRS
from pyproj.exceptions import CRSError
from rasterio.enums import Resampling
from rasterio.transform import from_origin
from rasterio.vrt import WarpedVRT
from rasterio.warp import calculate_default_transform

from orthomill.schemas.errors import WorkflowError

MOST_PIXELS = 10**11
"""of a file: more is a cell or an area given by mistake"""


@dataclass(frozen=True)
class Wanted:
    """What is asked for: a system ("EPSG:3857"; None: that of the product), an area (west, south, east, north) in it, and its
    cell, in units of the system; None: all of it, the cell of the product."""

    crs: str | None = None
    area: tuple[float, float, float, float] | None = None
    cell: float | None = None


@contextmanager
def warped(path: Path, wanted: Wanted) -> Iterator[WarpedVRT]:
    """The product as it is wanted. Raises WorkflowError with a sentence for what cannot be."""
    with rasterio.open(path) as source:
        if source.crs is None:
            raise WorkflowError(f"{path.name} has no reference system, so that it has no place in another one: leave out --crs.")
        system = _system(wanted.crs) if wanted.crs else source.crs
        transform, width, height = _grid(source, system, wanted)
        codes = source.count == 1 and source.dtypes[0] in ("uint8", "uint16")
        coarser = wanted.cell is not None and wanted.cell > 1.5 * abs(transform.a if system == source.crs else source.transform.a)
        how = Resampling.nearest if codes else Resampling.average if coarser else Resampling.cubic
        options = {"crs": system, "transform": transform, "width": width, "height": height, "resampling": how}
        with WarpedVRT(source, **options) as view:
            yield view


def _system(text: str) -> rasterio.crs.CRS:
    try:
        return rasterio.crs.CRS.from_wkt(CRS.from_user_input(text).to_2d().to_wkt("WKT2_2019"))
    except CRSError as error:
        raise WorkflowError(f"--crs {text} is no reference system that PROJ knows; give a code such as EPSG:25832.") from error


def _grid(source: rasterio.DatasetReader, system: rasterio.crs.CRS, wanted: Wanted) -> tuple[rasterio.Affine, int, int]:
    """The transform and size of the file: cells on whole multiples of their size, so that files of neighbouring areas fit
    together."""
    known, width, height = source.transform, source.width, source.height
    if system != source.crs:
        known, width, height = calculate_default_transform(source.crs, system, source.width, source.height, *source.bounds)
    elif wanted.area is None and wanted.cell is None:
        return known, width, height
    cell = wanted.cell or known.a
    west, north = known.c, known.f
    bounds = (west, north + height * known.e, west + width * known.a, north)
    area = wanted.area or bounds
    if not (area[0] < area[2] and area[1] < area[3]):
        raise WorkflowError("--area is west, south, east and north in the system of the file: west and south come first.")
    if area[0] >= bounds[2] or area[2] <= bounds[0] or area[1] >= bounds[3] or area[3] <= bounds[1]:
        shown = ", ".join(f"{value:.10g}" for value in bounds)
        raise WorkflowError(
            f"--area does not meet {Path(source.name).name}, which covers {shown} (west, south, east, north) there."
        )
    left, top = _multiple(area[0], cell), -_multiple(-area[3], cell)
    cols, rows = max(ceil((area[2] - left) / cell - 1e-6), 1), max(ceil((top - area[1]) / cell - 1e-6), 1)
    if cols * rows > MOST_PIXELS:
        raise WorkflowError(
            f"A file of {cols} x {rows} pixels is asked for; give --cell in units of the system, or a smaller --area."
        )
    return from_origin(left, top, cell, cell), cols, rows


def _multiple(value: float, cell: float) -> float:
    """The greatest whole multiple of the cell that is not above the value; the value itself where that is one but for rounding."""
    count = value / cell
    return (round(count) if abs(count - round(count)) < 1e-6 else count // 1) * cell
