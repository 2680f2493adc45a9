"""A store in memory for tests of exports and reports; it remembers the largest window that was read."""

from contextlib import contextmanager

import numpy as np

from orthomill.schemas.errors import StoreError
from orthomill.schemas.raster import RasterSpec, Window

GREEK = "EPSG:2100"
TRANSFORM = (0.5, 0.0, 409000.0, 0.0, -0.5, 4357000.0)


class MemoryStore:
    def __init__(self):
        self.specs, self.arrays, self.tables = {}, {}, {}
        self.largest, self.files = 0, None

    def put(self, name, array, chunk=64, crs=GREEK, transform=TRANSFORM, **more):
        self.specs[name] = RasterSpec(
            name=name, shape=array.shape, dtype=str(array.dtype), chunk=chunk, crs=crs, transform=transform, **more
        )
        self.arrays[name] = array
        return self

    def put_table(self, table, value):
        self.tables[table.path] = value
        return self

    def names(self):
        return tuple(self.specs)

    def spec(self, name):
        if name not in self.specs:
            raise StoreError(f"There is no raster {name}.")
        return self.specs[name]

    def read(self, name, window: Window) -> np.ndarray:
        array = self.arrays[name]
        assert window.clipped(array.shape) == window, "a read leaves the raster"
        self.largest = max(self.largest, window.height * window.width)
        return array[window.slices]

    def file_names(self, folder):
        place = self.files / folder if self.files else None
        return tuple(sorted(path.name for path in place.iterdir())) if place and place.is_dir() else ()

    @contextmanager
    def local(self, name):
        yield self.files / name

    def has_table(self, table):
        return table.path in self.tables

    def table(self, table):
        if table.path not in self.tables:
            raise StoreError(f"There is no table {table.path}.")
        return self.tables[table.path]
