"""The project's store: rasters in one zarr v3 group, tables next to it.

A raster is created once from its specification; a write must be whole chunks, because unaligned concurrent writes to zarr lose data
silently. Every raster has a birth mark: the record of a job is valid only as long as the raster it wrote is still the same one.
Every chunk ends with a checksum, which is compared when it is read.
"""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import numpy as np

from orthomill.pipeline.storage.array_metadata import METADATA, StoredArray, array_metadata, ensure_groups, stored_array
from orthomill.pipeline.storage.chunk_codec import UnknownCodec
from orthomill.pipeline.storage.depots.depot import Depot, KeptFile
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.pipeline.storage.depots.side_by_side import side_by_side
from orthomill.pipeline.storage.file_names import path_of
from orthomill.pipeline.storage.map_axes import dimension_names, map_attributes, write_axes
from orthomill.pipeline.storage.tables.table_files import read_table, write_table
from orthomill.pipeline.storage.zarr_arrays import put_array
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Raster, Table
from orthomill.schemas.raster import RasterSpec, Window

T = TypeVar("T")


RASTERS = "rasters.zarr"
"""the group of all rasters"""


class Store:
    """Rasters and tables of one run. Cheap to create; every worker creates its own."""

    def __init__(self, place: Path | Depot, arrays: dict[str, StoredArray] | None = None) -> None:
        self.depot = depot_of(place)
        self._arrays: dict[str, StoredArray] = {} if arrays is None else arrays
        """what is known of rasters, by name; given where others have looked at them that are still the same"""
        self.written: dict[str, KeptFile] = {}
        """the files of chunks that were written here, by name in the depot"""

    @property
    def folder_name(self) -> str:
        """The last part of where the results are kept: the project's name."""
        return PurePosixPath(self.depot.address).name

    @property
    def rasters(self) -> Any:
        """The group of all rasters as other programs open it: a folder, or zarr's own object store."""
        if isinstance(self.depot, Folder):
            return self.depot.path / RASTERS
        from zarr.storage import ObjectStore

        from orthomill.pipeline.storage.depots.bucket import bucket_of

        return ObjectStore(bucket_of(f"{self.depot.address}/{RASTERS}").store, read_only=True)

    def place(self, name: str) -> str:
        """The folder of a raster in the depot."""
        return f"{RASTERS}/{path_of(name).as_posix()}"

    def names(self) -> tuple[str, ...]:
        """Names of all rasters that exist, sorted."""
        return tuple(sorted(self._walk(RASTERS)))

    def _walk(self, folder: str) -> Iterator[str]:
        for entry in self.depot.folders(folder):
            inside = f"{folder}/{entry}"
            if metadata := array_metadata(self.depot, inside):
                if "spec" in metadata["attributes"]:  # coordinates of map axes are arrays too, but no rasters
                    yield metadata["attributes"]["spec"]["name"]
            else:
                yield from self._walk(inside)

    def create(self, spec: RasterSpec) -> str:
        """Create the raster unless it exists with the same specification; returns its birth mark. Raises StoreError."""
        try:
            if self.holds(spec):
                return self.birth(spec.name)
            self.delete(spec.name)
            ensure_groups(self.depot, RASTERS, self.place(spec.name).rpartition("/")[0])
            self._new_array(spec)
            write_axes(self.depot, RASTERS, spec)
        except OSError as error:
            raise StoreError(
                f"The raster {spec.name} cannot be created in {self.depot.address}: {error.strerror}; make room or make it "
                "writable."
            ) from error
        return self.birth(spec.name)

    def _new_array(self, spec: RasterSpec) -> None:
        from zarr.codecs import BloscCodec, Crc32cCodec

        wanted = {
            "shape": spec.shape,
            "chunks": spec.chunks,
            "dtype": spec.dtype,
            "fill_value": _fill_value(spec),
            # lz4 at its fastest level: reading and writing must not cost more than computing a tile.
            "compressors": (BloscCodec(cname="lz4", clevel=1, shuffle="shuffle"), Crc32cCodec()),
            "dimension_names": dimension_names(spec),
            "attributes": {"spec": spec.model_dump(mode="json"), "birth": uuid.uuid4().hex, **map_attributes(spec)},
        }
        put_array(self.depot, self.place(spec.name), wanted)

    def mend(self, spec: RasterSpec) -> list[str]:
        """Write again what belongs to no job, where it is lost or damaged: the groups and the map axes of a raster. Returns it."""
        group = self.place(spec.name).rpartition("/")[0]
        return [*ensure_groups(self.depot, RASTERS, group), *write_axes(self.depot, RASTERS, spec)]

    def sweep(self) -> None:
        """Remove what a killed run was writing: files under temporary names, which nothing reads. Nothing else may write now."""
        self.depot.sweep()

    def delete(self, name: str) -> None:
        """Remove a raster with its data."""
        self._arrays.pop(name, None)
        with suppress(OSError):  # a folder that cannot be removed cannot be written either, which is told then
            self.depot.clear(self.place(name))

    def has(self, name: str) -> bool:
        """Whether there is a raster of this name, sound or not."""
        return self.depot.state(f"{self.place(name)}/{METADATA}") is not None

    def is_sound(self, name: str) -> bool:
        """Whether a raster exists and its metadata are whole."""
        return stored_array(self.depot, self.place(name)) is not None

    def holds(self, spec: RasterSpec) -> bool:
        """Whether a raster of this specification exists, with metadata that are whole."""
        found = stored_array(self.depot, self.place(spec.name))
        return found is not None and found.spec.same(spec)

    def _array(self, name: str) -> StoredArray:
        if name not in self._arrays:
            found = stored_array(self.depot, self.place(name))
            if found is None:
                raise StoreError(self._why_not(name))
            self._arrays[name] = found
        return self._arrays[name]

    def _why_not(self, name: str) -> str:
        if not self.has(name):
            return f"There is no raster {name} in {self.depot.address}; run the stage '{name.split('/')[0]}' first."
        if inside := [other for other in self.names() if other.startswith(f"{name}/")]:
            return f"{name} is no raster but holds several, such as {', '.join(inside[:3])}."
        return f"The metadata of the raster {name} are damaged; run again, and it is computed again."

    def spec(self, name: str) -> RasterSpec:
        """The specification a raster was made from. Raises StoreError when there is none."""
        return self._array(name).spec

    def birth(self, name: str) -> str:
        """The mark of its creation. Raises StoreError where there is no raster."""
        return self._array(name).birth

    def read(self, name: str, window: Window) -> np.ndarray:
        """Pixels (height, width) or (height, width, bands) of a window that lies inside the raster. Raises StoreError."""
        array = self._array(name)
        if window.clipped(array.shape) != window:
            raise StoreError(f"{window} extends beyond the raster {name} of shape {array.shape}; clip it first.")
        try:
            values = np.full(window.shape + array.shape[2:], array.codec.fill, array.codec.dtype)
            chunks = list(self._chunks(name, array, window))
            contents = side_by_side(self.depot, self._content, [file for file, _ in chunks])
            for (_, chunk), content in zip(chunks, contents, strict=True):
                if content is not None:  # else nothing but its fill value
                    both = window.overlap(chunk)
                    values[both.within(window).slices] = array.codec.decode(content)[both.within(chunk).slices]
        except UnknownCodec as error:
            raise StoreError(f"The raster {name} cannot be read: {error}; remove it, and it is computed again.") from error
        except (ValueError, RuntimeError) as error:  # a wrong checksum, and the word of the decompressor
            raise StoreError(f"The raster {name} is damaged in {window}; run again, and it is computed again.") from error
        return values

    def _content(self, name: str) -> bytes | None:
        try:
            return self.depot.get(name)
        except FileNotFoundError:
            return None

    def write(self, name: str, window: Window, values: np.ndarray) -> None:
        """Write whole chunks. Raises StoreError for windows that cut a chunk and for values of another shape or kind."""
        array = self._array(name)
        _check_aligned(name, window, array.shape, array.codec.shape)
        expected = window.shape + array.shape[2:]
        if values.shape != expected:
            raise StoreError(f"{name} takes {expected} in {window}, but was given {values.shape}.")
        # float64 to float32 is intended; float to integer would truncate heights to metres without an error.
        if not np.can_cast(values.dtype, array.codec.dtype, casting="same_kind"):
            raise StoreError(f"{name} holds {array.codec.dtype}, but was given {values.dtype}.")
        try:
            for file, chunk in self._chunks(name, array, window):
                self._write_chunk(file, array.codec.encode(values[window.overlap(chunk).within(window).slices]))
        except OSError as error:
            raise StoreError(
                f"The raster {name} cannot be written: {error.strerror}; make room on the disk, then run again."
            ) from error

    def _write_chunk(self, name: str, content: bytes | None) -> None:
        if content is None:
            self.depot.delete(name)
        else:
            self.written[name] = self.depot.put(name, content)

    def _chunks(self, name: str, array: StoredArray, window: Window) -> Iterator[tuple[str, Window]]:
        """The file and the window of every chunk that a window touches."""
        high, wide = array.codec.shape[:2]
        bands = "/0" * (len(array.shape) - 2)
        place = self.place(name)
        for row in range(window.row // high, -(-(window.row + window.height) // high)):
            for col in range(window.col // wide, -(-(window.col + window.width) // wide)):
                yield f"{place}/c/{row}/{col}{bands}", Window(row * high, col * wide, high, wide)

    def files(self, output: Raster | Table[Any]) -> Iterator[str]:
        """The files that hold an output that was written here. A chunk that is nothing but its fill value has none."""
        if isinstance(output, Table):
            yield self.table_path(output)
            return
        yield from (file for file, _ in self._chunks(output.name, self._array(output.name), output.window) if file in self.written)

    def is_there(self, output: Raster | Table[Any]) -> bool:
        """Whether there is a table, or the first chunk of a window of a raster. Raises StoreError where there is no raster."""
        if isinstance(output, Table):
            return self.has_table(output)
        first, _ = next(self._chunks(output.name, self._array(output.name), output.window))
        return self.depot.state(first) is not None

    def has_table(self, table: Table[Any]) -> bool:
        return self.depot.state(self.table_path(table)) is not None

    def table_path(self, table: Table[Any]) -> str:
        """The name of a table's file in the depot."""
        return f"tables/{path_of(table.path, PurePosixPath(table.path).suffix).as_posix()}"

    def table(self, table: Table[T]) -> T:
        """The value of a table. Raises StoreError."""
        return read_table(self.depot, self.table_path(table), table)

    def file(self, name: str) -> bytes:
        """A file that an export wrote, by its path in the run's folder. Raises StoreError when it is absent."""
        try:
            return self.depot.get(name)
        except FileNotFoundError:
            raise StoreError(f"{self.depot.address}/{name} is absent; run again, it is made anew then.") from None

    def file_names(self, folder: str) -> tuple[str, ...]:
        """Names of the files that lie directly in a folder of the run."""
        return tuple(sorted(name for name, _ in self.depot.entries(folder)))

    @contextmanager
    def local(self, name: str) -> Iterator[Path]:
        """A path under which other libraries read such a file. Raises StoreError when it is absent."""
        if self.depot.state(name) is None:
            raise StoreError(f"{self.depot.address}/{name} is absent; run again, it is made anew then.")
        with self.depot.local(name) as path:
            yield path

    def write_table(self, table: Table[T], value: T) -> None:
        """Store a table whole. Raises StoreError when the value is not of the table's type."""
        if not isinstance(value, table.type):
            raise StoreError(f"The table {table.path} holds {table.type.__name__}, but was given {type(value).__name__}.")
        write_table(self.depot, self.table_path(table), value)


def aligned(window: Window, shape: tuple[int, ...], chunks: tuple[int, ...]) -> bool:
    """Whether a window covers whole chunks of an array."""
    bottom, right = window.row + window.height, window.col + window.width
    return (
        not window.empty
        and window.clipped(shape) == window
        and window.row % chunks[0] == 0
        and window.col % chunks[1] == 0
        and (bottom % chunks[0] == 0 or bottom == shape[0])
        and (right % chunks[1] == 0 or right == shape[1])
    )


def _check_aligned(name: str, window: Window, shape: tuple[int, ...], chunks: tuple[int, ...]) -> None:
    if not aligned(window, shape, chunks):
        raise StoreError(f"A write to {name} must be whole chunks of {chunks[:2]} inside {shape[:2]}, but was {window}.")


def _fill_value(spec: RasterSpec) -> float | int:
    if spec.nodata is not None:
        return spec.nodata
    return 0
