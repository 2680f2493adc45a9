"""A job: which regions it reads and writes, and which pure function computes the latter from the former.

The engine derives every dependency from the regions. A region is a window of a raster, a table, a file of the project, or the
header of a photograph. Arguments of the function arrive under the names of `reads` and `params`: a region as its value, a tuple of
regions as a tuple, a `Stream` as an iterator that reads the next region, or group of regions, when it is asked. It returns the bare
value when the job writes one region, and otherwise a NamedTuple whose fields are the names of `writes` (`dict[str, T]` where the
names depend on the data). The engine compares all of this with the annotations of the function when the graph is built.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Generic, TypeVar

import numpy as np

from orthomill.schemas.raster import MapGrid, Window

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Raster:
    """A window of the raster called `name`."""

    name: str
    window: Window


@dataclass(frozen=True, slots=True)
class Table(Generic[T]):
    """A table of the project, by its path under tables/: `*.json` holds a pydantic model, `*.parquet` a `Columns`."""

    path: str
    type: type[T]
    # The engine refuses other readers when it builds the graph: a stage that reads the truth would judge itself.
    readers: tuple[str, ...] | None = None
    """stages that may read it; None: all. The declaration of its writer counts."""


@dataclass(frozen=True, slots=True)
class PhotoPixels:
    """Pixels of an image file: (height, width, bands), in the file's own dtype and orientation. Window in file pixels."""

    # File pixels, because decoders cut windows in file order only; the stage `photos` turns them upright.
    path: str
    window: Window


@dataclass(frozen=True, slots=True)
class PhotoHeader:
    """The validated header of an image file; arrives as an `orthomill.schemas.photo.Header`."""

    path: str


@dataclass(frozen=True, slots=True)
class PhotoPicture:
    """Whether the picture of an image file is whole; arrives as an `orthomill.schemas.photo.Soundness`."""

    path: str


@dataclass(frozen=True, slots=True)
class TextFile:
    """A small text file of the project; arrives as `str`."""

    path: str


@dataclass(frozen=True, slots=True)
class MapFile:
    """A window of a georeferenced raster file, resampled to `grid` in `crs`.

    Arrives as float32 (height, width), or (height, width, bands) when `bands` > 1; NaN where the file has no value.
    """

    path: str
    crs: str
    grid: MapGrid
    window: Window
    # float32 for every file type: at heights below 8192 m its steps are under 0.5 mm, and NaN marks gaps in integer files too.
    bands: int = 1


@dataclass(frozen=True, slots=True)
class MapHeader:
    """The extent of a georeferenced raster file; arrives as an `orthomill.schemas.raster.MapGrid` of its bounds in `crs`."""

    path: str
    crs: str


@dataclass(frozen=True, slots=True)
class MeshFile:
    """A mesh or a point cloud; arrives as an `orthomill.schemas.solid.mesh.TriangleMesh`, in the file's own units and system.

    A point cloud has no triangles.
    """

    path: str


@dataclass(frozen=True, slots=True)
class CloudFile:
    """A point cloud (LAS, LAZ); arrives as an `orthomill.schemas.solid.cloud_points.CloudPoints`: metres in `crs`, heights in its
    vertical system where both name one. A file that names no system is taken to be in `crs`."""

    path: str
    crs: str


@dataclass(frozen=True, slots=True)
class AreaFile:
    """Polygons (GeoPackage, GeoJSON); arrives as an `orthomill.schemas.maps.wanted_area.WantedArea` in `crs`."""

    path: str
    crs: str


@dataclass(frozen=True, slots=True)
class HeightFile:
    """A window of a surface of the user, a GeoTIFF or a point cloud (LAS, LAZ), on `grid` in `crs`.

    Arrives as float32 (height, width): metres, in the vertical system of `crs` where both name one; NaN where the file has none.
    """

    path: str
    crs: str
    grid: MapGrid
    window: Window
    system: str | None = None
    """reference system of a file that names none"""


@dataclass(frozen=True, slots=True)
class HeightHeader:
    """The extent of such a file; arrives as an `orthomill.schemas.raster.MapGrid` of its bounds in `crs`, in cells as wide as its
    own or as the usual distance of its points."""

    path: str
    crs: str
    system: str | None = None


FileRegion = (
    PhotoPixels
    | PhotoHeader
    | PhotoPicture
    | TextFile
    | MapFile
    | MapHeader
    | HeightFile
    | HeightHeader
    | MeshFile
    | CloudFile
    | AreaFile
)
"""What is read from a file outside the store: one of the user's, or one that a job exports."""
Region = Raster | Table | FileRegion


@dataclass(frozen=True, slots=True)
class Stream:
    """Regions that are read one at a time, or group by group, in their order, when the function asks for the next one.

    Arrives as an `Iterator` of what the regions hold, of a group as a tuple: it runs once, and need not run to its end. Memory is
    planned for two regions, however many there are, and for one group: the function lets go of it before it asks for the next.
    """

    regions: tuple[Region | tuple[Region, ...], ...]

    @property
    def in_groups(self) -> bool:
        """Whether it has groups."""
        return any(isinstance(entry, tuple) for entry in self.regions)


Reading = Region | tuple[Region, ...] | Stream
"""What one argument of a function is read from."""


def regions_of(reading: Reading) -> tuple[Region, ...]:
    """All regions of one argument."""
    if isinstance(reading, Stream):
        return tuple(region for entry in reading.regions for region in regions_of(entry))
    return reading if isinstance(reading, tuple) else (reading,)


@dataclass(frozen=True, slots=True)
class Job:
    """One unit of work. (stage, item, row, col) is its identity, its Dask key and its row in the records."""

    stage: str
    item: str
    function: Callable[..., Any]
    # Mappings are covariant in their values, so that a stage may pass a dict[str, Table] without a cast.
    reads: Mapping[str, Reading]
    writes: Mapping[str, Raster | Table]
    params: dict[str, Any] = field(default_factory=dict)
    row: int = 0
    col: int = 0
    # Declared, because the engine plans memory before a job runs and cannot see what NumPy and numba will allocate in it.
    scratch: int = 0
    """Working memory of the function beyond what it reads and writes, in bytes."""
    remedy: str = "set a smaller 'tile' in the workflow"
    """What else than more memory lets the job fit a worker."""

    @property
    def key(self) -> tuple[str, str, int, int]:
        """(stage, item, row, col): its name in the graph, in the records and on the dashboard."""
        return self.stage, self.item, self.row, self.col


@dataclass(frozen=True, slots=True)
class Export:
    """A file written from rasters, block by block; the path is relative to the run's folder.

    `format`: "cog" (GeoTIFF with overviews), "tiff" (plain tiled TIFF, no georeference), "png", "laz" (the rows of `tables`, or
    the cells of the raster "z", as points with the colours of "rgb" and attributes), "json" or "csv" (the one table of `tables`),
    "text", "bytes" (the content of the one table of `tables`, a `FileBytes`), "xyz" (X, Y and the first band of the one raster as
    text, a line for every cell with a value), "gpkg", "dxf" or "geojson" (the lines of the tables, of `MapLines`, in the
    reference system of the raster "place"), "map" (a page for a browser from a `MapPage` and the files of its parts, which
    `orthomill.schemas.maps.map_parts` names: "map shades", "map tiles", "map values", "map points", "map lines"), "areas"
    (GeoPackage with the areas of the raster "codes", named by the one table, a `CodedAreas`). The engine turns a large "cog" or
    "laz" of rasters into several "cog part" and a "cog of parts", a very large "cog" into "cog sheet" and a "cog of sheets".
    """

    stage: str
    item: str
    path: str
    format: str
    rasters: dict[str, str] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    beside: tuple[Table, ...] = ()
    """of "laz": tables with further columns for the rows of `tables`, one for each of them"""
    window: Window | None = None
    """the part of its rasters that it reads, in pixels of the first, and of those on other grids the same ground; None: all"""
    files: tuple[str, ...] = ()
    """files of other exports that it reads, relative to the run's folder"""
    row: int = 0
    col: int = 0

    @property
    def key(self) -> tuple[str, str, int, int]:
        """(stage, item, row, col): its name beside those of jobs."""
        return self.stage, self.item, self.row, self.col


# A dataclass, unlike the other tables: pydantic would validate millions of rows value by value.
@dataclass(frozen=True)
class Columns:
    """A long table: every field is a 1-D array of the same length (subclass and add fields). Stored as parquet."""

    def __post_init__(self) -> None:
        lengths = {f.name: len(getattr(self, f.name)) for f in fields(self)}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"columns of {type(self).__name__} differ in length: {lengths}")

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def take(self, index: np.ndarray) -> Any:
        """The rows at `index` (numbers or a mask)."""
        return type(self)(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


@dataclass(frozen=True)
class FileBytes(Columns):
    """A whole file that a job made, for formats that only its stage knows."""

    content: np.ndarray
    """uint8"""

    @staticmethod
    def of(data: bytes) -> "FileBytes":
        """From bytes."""
        return FileBytes(np.frombuffer(data, np.uint8))
