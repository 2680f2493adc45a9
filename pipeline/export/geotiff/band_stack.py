"""Rasters of one grid as the bands of one file."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import rasterio
from rasterio.enums import ColorInterp

from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Export
from orthomill.schemas.raster import RasterSpec, Window, tiles_of

COLOURS = {3: ("red", "green", "blue"), 4: ("red", "green", "blue", "alpha")}


@dataclass(frozen=True)
class Stack:
    """Rasters on one grid, stacked as bands of one dtype with one nodata value."""

    specs: dict[str, RasterSpec]
    dtype: np.dtype
    nodata: float | None

    @property
    def first(self) -> RasterSpec:
        """The raster of the first band, whose grid is that of all."""
        return next(iter(self.specs.values()))

    @property
    def chunk(self) -> int:
        """Side of the windows that are written, px."""
        return max(self.first.chunk, 128)

    @property
    def bands(self) -> int:
        """Number of bands of all rasters."""
        return sum(_bands(spec) for spec in self.specs.values())

    @property
    def is_picture(self) -> bool:
        """Whether this is one raster of 3 or 4 unsigned integer bands: red, green, blue and perhaps alpha."""
        return len(self.specs) == 1 and self.bands in COLOURS and self.dtype.kind == "u"

    @property
    def has_codes(self) -> bool:
        """Whether some band holds integer codes, whose mean has no meaning."""
        return not self.is_picture and any(np.dtype(spec.dtype).kind in "ui" for spec in self.specs.values())

    def bounds(self, window: Window) -> tuple[float, float, float, float]:
        """West, south, east and north of a window."""
        cell, _, west, _, down, north = self.first.transform or (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
        left, top = west + cell * window.col, north + down * window.row
        return left, top + down * window.height, left + cell * window.width, top

    def is_blank(self, values: np.ndarray) -> bool:
        """Whether values are nothing but what is shown where there is no file: nodata, or 0 where there is no such value."""
        nothing = 0 if self.nodata is None else self.nodata
        return bool(np.isnan(values).all() if nothing != nothing else (values == nothing).all())

    def windows(self) -> Iterator[Window]:
        """The windows that cover the grid."""
        return (tile.window for tile in tiles_of(self.first.shape, self.chunk))

    def read(self, store: ReadableStore, window: Window) -> np.ndarray:
        """(bands, height, width) of a window, in the stack's dtype and nodata."""
        return np.concatenate([self._bands_of(store, spec, window) for spec in self.specs.values()])

    def _bands_of(self, store: ReadableStore, spec: RasterSpec, window: Window) -> np.ndarray:
        values = store.read(spec.name, window)
        bands = values[None] if values.ndim == 2 else np.moveaxis(values, 2, 0)
        converted = bands.astype(self.dtype, copy=False)
        # Bands with different nodata values share NaN; a nodata of NaN needs no replacement, and is not equal to itself.
        if spec.nodata is not None and spec.nodata == spec.nodata and self.nodata != self.nodata:
            converted = np.where(bands == spec.nodata, self.dtype.type(np.nan), converted)
        return converted

    def descriptions(self) -> Iterator[tuple[str, str]]:
        """(description, unit) of every band."""
        for label, spec in self.specs.items():
            names = COLOURS[self.bands] if self.is_picture else _band_names(label, _bands(spec))
            yield from ((f"{name} ({spec.unit})" if spec.unit else name, spec.unit) for name in names)


def _bands(spec: RasterSpec) -> int:
    return spec.shape[2] if len(spec.shape) == 3 else 1


def _band_names(label: str, bands: int) -> list[str]:
    return [label] if bands == 1 else [f"{label} {number + 1}" for number in range(bands)]


def stack_of(export: Export, store: ReadableStore) -> Stack:
    """The rasters of `export` as one stack: their common dtype and nodata, or float32 with NaN where they differ.

    Raises StoreError when there are none or when they are not on one grid.
    """
    specs = {label: store.spec(name) for label, name in export.rasters.items()}
    if not specs:
        raise StoreError(f"{export.path} names no raster; an export as {export.format} needs at least one.")
    first = next(iter(specs.values()))
    for spec in specs.values():
        if (spec.shape[:2], spec.transform, spec.crs) != (first.shape[:2], first.transform, first.crs):
            raise StoreError(
                f"{export.path} combines {first.name} and {spec.name}, which are on different grids; export them to separate files."
            )
    return Stack(specs, *_type_and_nodata(tuple(specs.values())))


def _type_and_nodata(specs: tuple[RasterSpec, ...]) -> tuple[np.dtype, float | None]:
    alike = len({(spec.dtype, str(spec.nodata)) for spec in specs}) == 1
    dtype = np.dtype(specs[0].dtype) if alike else np.dtype(np.float32)
    if not alike and all(np.dtype(spec.dtype).kind == "u" and spec.nodata is None for spec in specs):
        return np.result_type(*(spec.dtype for spec in specs)), None
    if dtype.kind == "f":
        return dtype, specs[0].nodata if alike and specs[0].nodata is not None else math.nan
    return dtype, specs[0].nodata


def describe(target: rasterio.io.DatasetWriter, stack: Stack) -> None:
    """Tell a file what its bands are."""
    if stack.is_picture:
        target.colorinterp = [ColorInterp[name] for name in COLOURS[stack.bands]]
    for band, (description, unit) in enumerate(stack.descriptions(), start=1):
        target.set_band_description(band, description)
        target.set_band_unit(band, unit)
