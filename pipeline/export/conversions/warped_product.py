"""A product of a run in another reference system, area or cell, read window by window.

The file of the product is warped by GDAL when a window is read, so that nothing but that window is in memory. Codes take the
nearest cell, heights and colours are interpolated, and averaged where cells become larger. What lies outside a cutline is as if the
product had nothing there: cells belong to the outline that holds their centre.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from math import ceil, isnan
from pathlib import Path

import numpy as np
import rasterio
import rasterio.features
from pyproj import CRS
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError
from rasterio.enums import Resampling
from rasterio.transform import from_origin
from rasterio.vrt import WarpedVRT
from rasterio.warp import calculate_default_transform
from rasterio.windows import Window

from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.storage.features.outline_files import Outline, read_outlines
from orthomill.schemas.errors import WorkflowError

MOST_PIXELS = 10**11
"""of a file: more is a cell or an area given by mistake"""


_PLANE = rasterio.crs.CRS.from_wkt('LOCAL_CS["plane",UNIT["metre",1]]')
"""of products on a wall, whose files name no system"""


class WarpedProduct:
    """A product as it is wanted, read window by window."""

    def __init__(self, view: WarpedVRT, outlines: tuple[Outline, ...]) -> None:
        self.view, self.outlines = view, outlines
        self.wkt = view.crs.to_wkt()
        """of the system in which it is computed"""
        self.width, self.height, self.count, self.bounds = view.width, view.height, view.count, view.bounds
        self.transform, self.dtypes = view.transform, view.dtypes
        self.crs = None if view.crs == _PLANE else view.crs
        self.has_alpha = view.colorinterp[-1] == rasterio.enums.ColorInterp.alpha
        # What is outside must be told from what is inside: 0 where the product itself has no such value.
        self.nodata = 0 if outlines and view.nodata is None and not self.has_alpha else view.nodata

    @property
    def profile(self) -> dict:
        """For a file of the same pixels."""
        return dict(self.view.profile) | {"nodata": self.nodata, "crs": self.crs}

    def read(self, window: Window, bands: list[int] | None = None) -> np.ndarray:
        """(bands, rows, cols) of a window; outside the cutline nodata, or 0 in all bands of a picture with transparency."""
        values = self.view.read(bands or list(range(1, self.count + 1)), window=window)
        if self.outlines:
            values[:, ~self._inside(window)] = 0 if self.nodata is None else self.nodata
        return values

    def seen(self, window: Window) -> np.ndarray:
        """(rows, cols) bool: where the product has something."""
        values = self.view.read(1, window=window) if self.nodata is not None else None
        if values is None or self.has_alpha:
            there = self.view.dataset_mask(window=window) > 0
        else:
            there = ~np.isnan(values) if isnan(self.nodata) else values != self.nodata
        return there & self._inside(window) if self.outlines else there

    def _inside(self, window: Window) -> np.ndarray:
        return rasterio.features.geometry_mask(
            [outline.shape() for outline in self.outlines],
            (int(window.height), int(window.width)),
            rasterio.windows.transform(window, self.transform),
            invert=True,
        )


@contextmanager
def warped(path: Path, wanted: Wanted) -> Iterator[WarpedProduct]:
    """The product as it is wanted. Raises WorkflowError with a sentence for what cannot be."""
    with rasterio.open(path) as source:
        if source.crs is None and (wanted.crs or wanted.cutline):
            raise WorkflowError(
                f"{path.name} has no reference system, so that it has no place on a map: leave out --crs and --cutline."
            )
        own = source.crs or _PLANE
        system = _with_heights_of(own, system_of(wanted.crs)) if wanted.crs else own
        outlines = read_outlines(wanted.cutline, system.to_wkt()) if wanted.cutline else ()
        transform, width, height = _grid(source, own, system, wanted, outlines)
        codes = source.count == 1 and source.dtypes[0] in ("uint8", "uint16")
        coarser = wanted.cell is not None and wanted.cell > 1.5 * _own_cell(source, own, system)
        how = Resampling.nearest if codes else Resampling.average if coarser else Resampling.cubic
        options = {"src_crs": own, "crs": system, "transform": transform, "width": width, "height": height, "resampling": how}
        with WarpedVRT(source, **options) as view:
            yield WarpedProduct(view, outlines)


def _own_cell(source: rasterio.DatasetReader, own: rasterio.crs.CRS, system: rasterio.crs.CRS) -> float:
    """The cell of a product of the system `own`, in units of the one that it is wanted in."""
    if system == own:
        return abs(source.transform.a)
    return abs(calculate_default_transform(own, system, source.width, source.height, *source.bounds)[0].a)


def system_of(text: str) -> rasterio.crs.CRS:
    """The plan part of a reference system as GDAL has it. Raises WorkflowError for one that PROJ does not know."""
    try:
        return rasterio.crs.CRS.from_wkt(plan_of(CRS.from_user_input(text)).to_wkt("WKT2_2019"))
    except CRSError as error:
        raise WorkflowError(f"--crs {text} is no reference system that PROJ knows; give a code such as EPSG:25832.") from error


def plan_of(system: CRS) -> CRS:
    """A system without its heights."""
    return system.sub_crs_list[0] if system.is_compound else system.to_2d()


def _with_heights_of(own: rasterio.crs.CRS, plan: rasterio.crs.CRS) -> rasterio.crs.CRS:
    """A plan system with what the heights of a product count from, which does not change: only places are transformed."""
    known = CRS.from_wkt(own.to_wkt())
    if not known.is_compound:
        return plan
    horizontal, vertical = CRS.from_wkt(plan.to_wkt()), known.sub_crs_list[1]
    both = CompoundCRS(f"{horizontal.name} + {vertical.name}", [horizontal, vertical])
    return rasterio.crs.CRS.from_wkt(both.to_wkt("WKT2_2019"))


def _grid(
    source: rasterio.DatasetReader, own: rasterio.crs.CRS, system: rasterio.crs.CRS, wanted: Wanted, outlines: tuple[Outline, ...]
) -> tuple[rasterio.Affine, int, int]:
    """The transform and size of the file: cells on whole multiples of their size, so that files of neighbouring areas fit
    together."""
    known, width, height = source.transform, source.width, source.height
    if system != own:
        known, width, height = calculate_default_transform(own, system, source.width, source.height, *source.bounds)
    elif wanted.area is None and wanted.cell is None and not outlines:
        return known, width, height
    cell = wanted.cell or known.a
    west, north = known.c, known.f
    bounds = (west, north + height * known.e, west + width * known.a, north)
    area = wanted.area or (_around(outlines, bounds) if outlines else bounds)
    if not (area[0] < area[2] and area[1] < area[3]):
        raise WorkflowError("--area is west, south, east and north in the system of the file: west and south come first.")
    if area[0] >= bounds[2] or area[2] <= bounds[0] or area[1] >= bounds[3] or area[3] <= bounds[1]:
        shown = ", ".join(f"{value:.10g}" for value in bounds)
        asked = "--area" if wanted.area else "The cutline"
        raise WorkflowError(
            f"{asked} does not meet {Path(source.name).name}, which covers {shown} (west, south, east, north) there."
        )
    left, top = _multiple(area[0], cell), -_multiple(-area[3], cell)
    cols, rows = max(ceil((area[2] - left) / cell - 1e-6), 1), max(ceil((top - area[1]) / cell - 1e-6), 1)
    if cols * rows > MOST_PIXELS:
        raise WorkflowError(
            f"A file of {cols} x {rows} pixels is asked for; give --cell in units of the system, or a smaller --area."
        )
    return from_origin(left, top, cell, cell), cols, rows


def _around(outlines: tuple[Outline, ...], bounds: tuple[float, ...]) -> tuple[float, float, float, float]:
    """West, south, east, north of the outlines, as far as they lie within the bounds; of the outlines alone where none does."""
    wests, souths, easts, norths = zip(*(outline.bounds for outline in outlines), strict=True)
    west, south, east, north = min(wests), min(souths), max(easts), max(norths)
    cut = max(west, bounds[0]), max(south, bounds[1]), min(east, bounds[2]), min(north, bounds[3])
    return cut if cut[0] < cut[2] and cut[1] < cut[3] else (west, south, east, north)


def _multiple(value: float, cell: float) -> float:
    """The greatest whole multiple of the cell that is not above the value; the value itself where that is one but for rounding."""
    count = value / cell
    return (round(count) if abs(count - round(count)) < 1e-6 else count // 1) * cell
