"""The project's store: rasters in one zarr v3 group, tables next to it.

A raster is created once from its specification; a write must be whole chunks, because unaligned concurrent writes to zarr lose data
silently. Every raster has a birth mark: the record of a job is valid only as long as the raster it wrote is still the same one.
Every chunk ends with a checksum, which is compared when it is read.
"""

import shutil
import uuid
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import numpy as np

from orthomill.pipeline.storage.array_metadata import METADATA, StoredArray, array_metadata, ensure_groups, seal_array, stored_array
from orthomill.pipeline.storage.chunk_codec import UnknownCodec
from orthomill.pipeline.storage.file_names import path_of
from orthomill.pipeline.storage.map_axes import dimension_names, map_attributes, write_axes
from orthomill.pipeline.storage.table_files import read_table, write_table
from orthomill.pipeline.storage.whole_files import replacing
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Raster, Table
from orthomill.schemas.raster import RasterSpec, Window

T = TypeVar("T")


class Store:
    """Rasters and tables of one run's folder. Cheap to create; every worker creates its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self._arrays: dict[str, StoredArray] = {}
        self.written: dict[Path, int] = {}
        """CRC-32 of the files that were written here"""

    @property
    def rasters(self) -> Path:
        return self.folder / "rasters.zarr"

    def place(self, name: str) -> Path:
        """The folder of a raster."""
        return self.rasters / path_of(name)

    def names(self) -> tuple[str, ...]:
        """Names of all rasters that exist, sorted."""
        return tuple(sorted(self._walk(self.rasters)))

    def _walk(self, folder: Path) -> Iterator[str]:
        if not folder.is_dir():
            return
        for entry in folder.iterdir():
            if not entry.is_dir():
                continue
            if metadata := array_metadata(entry):
                if "spec" in metadata["attributes"]:  # coordinates of map axes are arrays too, but no rasters
                    yield metadata["attributes"]["spec"]["name"]
            else:
                yield from self._walk(entry)

    def create(self, spec: RasterSpec) -> str:
        """Create the raster unless it exists with the same specification; returns its birth mark. Raises StoreError."""
        try:
            if self.holds(spec):
                return self.birth(spec.name)
            self.delete(spec.name)
            ensure_groups(self.rasters, self.place(spec.name).parent)
            self._new_array(spec)
            write_axes(self.rasters, spec)
        except OSError as error:
            raise StoreError(
                f"The raster {spec.name} cannot be created in {self.rasters}: {error.strerror}; make room or make it writable."
            ) from error
        return self.birth(spec.name)

    def _new_array(self, spec: RasterSpec) -> None:
        import zarr
        from zarr.codecs import BloscCodec, Crc32cCodec

        zarr.create_array(
            self.rasters,
            name=path_of(spec.name).as_posix(),
            shape=spec.shape,
            chunks=spec.chunks,
            dtype=spec.dtype,
            fill_value=_fill_value(spec),
            # lz4 at its fastest level: reading and writing must not cost more than computing a tile.
            compressors=(BloscCodec(cname="lz4", clevel=1, shuffle="shuffle"), Crc32cCodec()),
            dimension_names=dimension_names(spec),
            attributes={"spec": spec.model_dump(mode="json"), "birth": uuid.uuid4().hex, **map_attributes(spec)},
        )
        seal_array(self.place(spec.name))

    def mend(self, spec: RasterSpec) -> list[Path]:
        """Write again what belongs to no job, where it is lost or damaged: the groups and the map axes of a raster. Returns it."""
        return [*ensure_groups(self.rasters, self.place(spec.name).parent), *write_axes(self.rasters, spec)]

    def sweep(self) -> None:
        """Remove what a killed run was writing: files under temporary names, which nothing reads. Nothing else may write now."""
        # zarr ends its temporary names in .partial, write_whole in .part.
        for path in self.folder.rglob("*.part*"):
            # A photograph may be called "part": then it is a folder that ends so.
            if path.suffix in {".partial", ".part"} and path.is_file():
                path.unlink(missing_ok=True)

    def delete(self, name: str) -> None:
        """Remove a raster with its data."""
        self._arrays.pop(name, None)
        shutil.rmtree(self.place(name), ignore_errors=True)

    def has(self, name: str) -> bool:
        return (self.place(name) / METADATA).exists()

    def is_sound(self, name: str) -> bool:
        """Whether a raster exists and its metadata are whole."""
        return stored_array(self.place(name)) is not None

    def holds(self, spec: RasterSpec) -> bool:
        """Whether a raster of this specification exists, with metadata that are whole."""
        found = stored_array(self.place(spec.name))
        return found is not None and found.spec.same(spec)

    def _array(self, name: str) -> StoredArray:
        if name not in self._arrays:
            found = stored_array(self.place(name))
            if found is None:
                raise StoreError(self._why_not(name))
            self._arrays[name] = found
        return self._arrays[name]

    def _why_not(self, name: str) -> str:
        if not self.has(name):
            return f"There is no raster {name} in {self.rasters}; run the stage '{name.split('/')[0]}' first."
        if inside := [other for other in self.names() if other.startswith(f"{name}/")]:
            return f"{name} is no raster but holds several, such as {', '.join(inside[:3])}."
        return f"The metadata of the raster {name} are damaged; run again, and it is computed again."

    def spec(self, name: str) -> RasterSpec:
        """The specification a raster was made from. Raises StoreError when there is none."""
        return self._array(name).spec

    def birth(self, name: str) -> str:
        return self._array(name).birth

    def read(self, name: str, window: Window) -> np.ndarray:
        """Pixels (height, width) or (height, width, bands) of a window that lies inside the raster. Raises StoreError."""
        array = self._array(name)
        if window.clipped(array.shape) != window:
            raise StoreError(f"{window} extends beyond the raster {name} of shape {array.shape}; clip it first.")
        try:
            values = np.full(window.shape + array.shape[2:], array.codec.fill, array.codec.dtype)
            for path, chunk in self._chunks(name, array, window):
                with suppress(FileNotFoundError):  # nothing but its fill value
                    both = window.overlap(chunk)
                    values[both.within(window).slices] = array.codec.decode(path.read_bytes())[both.within(chunk).slices]
        except UnknownCodec as error:
            raise StoreError(f"The raster {name} cannot be read: {error}; remove it, and it is computed again.") from error
        except (ValueError, RuntimeError) as error:  # a wrong checksum, and the word of the decompressor
            raise StoreError(f"The raster {name} is damaged in {window}; run again, and it is computed again.") from error
        return values

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
            for path, chunk in self._chunks(name, array, window):
                self._write_chunk(path, array.codec.encode(values[window.overlap(chunk).within(window).slices]))
        except OSError as error:
            raise StoreError(
                f"The raster {name} cannot be written: {error.strerror}; make room on the disk, then run again."
            ) from error

    def _write_chunk(self, path: Path, content: bytes | None) -> None:
        if content is None:
            path.unlink(missing_ok=True)
            return
        with replacing(path) as stream:
            stream.write(content)
        self.written[path] = zlib.crc32(content)

    def _chunks(self, name: str, array: StoredArray, window: Window) -> Iterator[tuple[Path, Window]]:
        """The file and the window of every chunk that a window touches."""
        high, wide = array.codec.shape[:2]
        bands = "/0" * (len(array.shape) - 2)
        place = self.place(name)
        for row in range(window.row // high, -(-(window.row + window.height) // high)):
            for col in range(window.col // wide, -(-(window.col + window.width) // wide)):
                yield place / f"c/{row}/{col}{bands}", Window(row * high, col * wide, high, wide)

    def files(self, output: Raster | Table[Any]) -> Iterator[Path]:
        """The files that hold an output. A chunk that is nothing but its fill value has none."""
        if isinstance(output, Table):
            yield self.table_path(output)
            return
        yield from (path for path, _ in self._chunks(output.name, self._array(output.name), output.window) if path.exists())

    def has_table(self, table: Table[Any]) -> bool:
        return self.table_path(table).exists()

    def table_path(self, table: Table[Any]) -> Path:
        return self.folder / "tables" / path_of(table.path, PurePosixPath(table.path).suffix)

    def table(self, table: Table[T]) -> T:
        """The value of a table. Raises StoreError."""
        return read_table(self.table_path(table), table)

    def write_table(self, table: Table[T], value: T) -> None:
        """Store a table whole. Raises StoreError when the value is not of the table's type."""
        if not isinstance(value, table.type):
            raise StoreError(f"The table {table.path} holds {table.type.__name__}, but was given {type(value).__name__}.")
        write_table(self.table_path(table), value)


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
