"""What exports, pictures and the report need from a store: names, specifications, windows and tables, all read-only."""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from orthomill.schemas.job import Table
from orthomill.schemas.raster import RasterSpec, Window

T = TypeVar("T")


class ReadableStore(Protocol):
    """The reading half of the store."""

    def names(self) -> tuple[str, ...]:
        """Rasters that exist."""

    def spec(self, name: str) -> RasterSpec:
        """The specification of a raster. Raises StoreError when it does not exist."""

    def read(self, name: str, window: Window) -> np.ndarray:
        """Pixels of a window: (height, width) or (height, width, bands)."""

    def table(self, table: Table[T]) -> T:
        """The value of a table. Raises StoreError when it is absent."""

    def file(self, name: str) -> bytes:
        """A file that an export wrote, by its path in the run's folder. Raises StoreError when it is absent."""

    def file_names(self, folder: str) -> tuple[str, ...]:
        """Names of the files that lie directly in a folder of the run."""

    def local(self, name: str) -> AbstractContextManager[Path]:
        """A path under which other libraries read such a file. Raises StoreError when it is absent."""

    def has_table(self, table: Table) -> bool:
        """Whether a table exists."""
