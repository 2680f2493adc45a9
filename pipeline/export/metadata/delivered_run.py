"""What is known of a finished run and its files, as all records of metadata take it."""

import hashlib
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rasterio
from pyproj import CRS

from orthomill.pipeline.storage.depots.folder import PRODUCTS, blocks_of
from orthomill.pipeline.storage.depots.kept_products import KeptProducts
from orthomill.pipeline.storage.depots.product_files import JOINED, WHOLE, as_they_lie, sheet_folder
from orthomill.pipeline.storage.features.outline_files import Outline, moved
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.accuracy.accuracy_statement import STATEMENT, AccuracyStatement
from orthomill.schemas.errors import StoreError
from orthomill.schemas.photo import PHOTOS, Photos
from orthomill.schemas.stage_report import StageReport, report_table

MEDIA = {
    ".tif": "image/tiff; application=geotiff; profile=cloud-optimized",
    ".vrt": "application/x-gdal-vrt",
    ".laz": "application/vnd.laszip",
    ".gpkg": "application/geopackage+sqlite3",
    ".geojson": "application/geo+json",
    ".json": "application/json",
    ".csv": "text/csv",
    ".html": "text/html",
    ".xml": "application/xml",
    ".png": "image/png",
    ".dxf": "image/vnd.dxf",
    ".yaml": "application/yaml",
    ".txt": "text/plain",
}


@dataclass(frozen=True)
class RunRecord:
    """A run: its name, the project's system, the version of orthomill, when it began and ended (ISO 8601), the workflow as it was
    run, and its stages with the seconds and jobs that they took."""

    project: str
    crs: str
    version: str
    started: str
    finished: str
    workflow: str
    stages: tuple[tuple[str, float, int], ...]


@dataclass(frozen=True)
class MapFacts:
    """A raster: WKT of its system, EPSG code (None: it has none), transform (6), shape (rows, cols), and of each band its
    description, unit and type; nodata as it is stored."""

    wkt: str
    epsg: int | None
    transform: tuple[float, ...]
    shape: tuple[int, int]
    bands: tuple[tuple[str, str, str], ...]
    nodata: float | None
    bounds: tuple[float, float, float, float]


@dataclass(frozen=True)
class DeliveredFile:
    """A file of products/: its name, size (bytes), digest, what it is for, and the stage that made it, where that is known."""

    name: str
    size: int
    sha256: str
    purpose: str = ""
    stage: str = ""
    map: MapFacts | None = None

    @property
    def media(self) -> str:
        """Its media type, by its suffix."""
        return MEDIA.get(Path(self.name).suffix, "application/octet-stream")


@dataclass(frozen=True)
class DeliveredRun:
    """A finished run. taken: first and last time of the photographs, ISO 8601 (None: they have none); outline: of the orthoimage or
    the surface, (N, 2) degrees; figures: values of the reports by name."""

    record: RunRecord
    photos: Photos
    files: tuple[DeliveredFile, ...]
    outline: np.ndarray
    taken: tuple[str, str] | None
    statement: AccuracyStatement = field(default_factory=AccuracyStatement)
    figures: dict[str, float] = field(default_factory=dict)

    @property
    def box(self) -> tuple[float, float, float, float]:
        """West, south, east, north, degrees."""
        (west, south), (east, north) = self.outline.min(axis=0), self.outline.max(axis=0)
        return float(west), float(south), float(east), float(north)


def delivered_run(folder: Path, record: RunRecord) -> DeliveredRun:
    """Reads a run's folder, all of its products for their digests. Raises StoreError before there is a product on the map."""
    store = Store(folder)
    kinds = [kind for kind, _, _ in record.stages]
    made = store.file_names(PRODUCTS)
    reports = {kind: as_they_lie(store.table(table), made) for kind in kinds if store.has_table(table := report_table(kind))}
    files = tuple(_files(KeptProducts(folder), reports))
    maps = {one.name.rpartition(".")[0]: one.map for one in files if one.map}
    shown = maps.get("ortho") or maps.get("dsm") or next(iter(maps.values()), None)
    if shown is None or not store.has_table(PHOTOS):
        raise StoreError(f"{folder.name} has no product on the map, so there is nothing for a catalogue.")
    return DeliveredRun(
        record=record,
        photos=store.table(PHOTOS),
        files=files,
        outline=_outline(shown),
        taken=_taken(store.table(PHOTOS)),
        statement=store.table(STATEMENT) if store.has_table(STATEMENT) else AccuracyStatement(),
        figures=dict(_figures(reports)),
    )


def _figures(reports: dict[str, StageReport]) -> Iterator[tuple[str, float]]:
    for kind, one in reports.items():
        for figure in one.figures:
            if isinstance(figure.value, float | int) and not isinstance(figure.value, bool):
                yield f"{kind}.{figure.name}", float(figure.value)


def _files(products: KeptProducts, reports: dict[str, StageReport]) -> Iterator[DeliveredFile]:
    made = {product.path: (kind, product.purpose) for kind, one in reports.items() for product in one.products}
    for name in products.names:
        folder, _, file = name.rpartition("/")
        # Folders hold tiles and files of other programs; catalogues list what a client opens.
        if folder == PRODUCTS and not file.startswith("."):
            stage, purpose = made.get(name, ("", ""))
            yield _file(products, name, purpose, stage)
            for sheet in products.names if name.endswith(JOINED) else ():
                if sheet.startswith(f"{sheet_folder(name)}/") and sheet.endswith(WHOLE):
                    yield _file(products, sheet, f"Sheet of {file}", stage)


def _file(products: KeptProducts, name: str, purpose: str, stage: str) -> DeliveredFile:
    called = name.removeprefix(f"{PRODUCTS}/")
    if not name.endswith((WHOLE, JOINED)):
        return DeliveredFile(called, products.size(name), _digest(products.blocks(name)), purpose, stage)
    # A raster is opened for its place on the map; of one that joins sheets that takes none of these.
    with products.opened(name) as path:
        return DeliveredFile(called, path.stat().st_size, _digest(blocks_of(path)), purpose, stage, _map_facts(path))


def _digest(blocks: Iterable[bytes]) -> str:
    digest = hashlib.sha256()
    for block in blocks:
        digest.update(block)
    return digest.hexdigest()


def _map_facts(path: Path) -> MapFacts | None:
    with rasterio.open(path) as source:
        if source.crs is None:
            return None
        bands = zip(source.descriptions, source.units, source.dtypes, strict=True)
        return MapFacts(
            wkt=source.crs.to_wkt(),
            epsg=CRS.from_wkt(source.crs.to_wkt()).to_2d().to_epsg(),
            transform=tuple(source.transform)[:6],
            shape=source.shape,
            bands=tuple((name or "", unit or "", dtype) for name, unit, dtype in bands),
            nodata=source.nodata,
            bounds=tuple(source.bounds),
        )


def _outline(shown: MapFacts) -> np.ndarray:
    west, south, east, north = shown.bounds
    ring = np.array([[west, south], [east, south], [east, north], [west, north], [west, south]])
    return moved(Outline("", (ring,)), shown.wkt, "EPSG:4326").rings[0]


def _taken(photos: Photos) -> tuple[str, str] | None:
    times = sorted(time for photo in photos.photos if (time := _iso(photo.time)))
    return (times[0], times[-1]) if times else None


def _iso(time: str | None) -> str:
    """A time of EXIF or ISO 8601, taken as UTC where no zone is known; empty where there is none."""
    found = re.match(r"(\d{4})[:-](\d\d)[:-](\d\d)[ T](\d\d:\d\d:\d\d)(?:\.\d+)?(Z|[+-]\d\d:\d\d)?", time or "")
    return f"{found[1]}-{found[2]}-{found[3]}T{found[4]}{found[5] or 'Z'}" if found else ""
