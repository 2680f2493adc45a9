"""What `orthomill export --as ...` makes of the products of a finished run."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from orthomill.pipeline.export.conversions.warped_product import Wanted
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError, WorkflowError

PICTURES, HEIGHTS, CAMERAS, MAPS = ("png", "jpeg"), ("hillshade", "slope"), ("cameras", "kml"), ("geotiff", "cog")
TILES = ("xyz", "mbtiles", "pmtiles")
KINDS = (*MAPS, *PICTURES, *HEIGHTS, *TILES, *CAMERAS)
"""formats by name"""
_ENDINGS = {
    "geotiff": ".tif",
    "cog": ".tif",
    "png": ".png",
    "jpeg": ".jpg",
    "hillshade": "_hillshade.tif",
    "slope": "_slope.tif",
    "xyz": "_tiles",
    "mbtiles": ".mbtiles",
    "pmtiles": ".pmtiles",
    "cameras": ".gpkg",
    "kml": ".kml",
}
_HEIGHT_PRODUCTS = ("terrain", "dsm")


@dataclass(frozen=True)
class Asked:
    """An export as the command line names it: format, product ("ortho"; None: the usual one), and how it is warped."""

    kind: str
    product: str | None
    wanted: Wanted
    path: str | None


def export_as(asked: Asked, folder: Path) -> Path:
    """Makes the file, or the folder of tiles, in the run's `folder`; its path. Raises WorkflowError and StoreError."""
    if asked.kind not in KINDS:
        raise WorkflowError(f"--as {asked.kind} is not known; formats are {', '.join(KINDS)}.")
    if asked.kind in (*CAMERAS, *TILES) and asked.wanted != Wanted():
        raise WorkflowError(f"--as {asked.kind} has its own system, area and cell; leave out --crs, --area and --cell.")
    stem = "cameras" if asked.kind in CAMERAS else _product(asked, folder).stem
    path = folder / (asked.path or f"products/exported/{stem}{_ENDINGS[asked.kind]}")
    if not path.resolve().is_relative_to(folder.resolve()):
        raise WorkflowError(f"{asked.path} is outside the run's folder {folder}; name a path inside it.")
    path.parent.mkdir(parents=True, exist_ok=True)
    if asked.kind in CAMERAS:
        _export_cameras(asked.kind, path, Store(folder))
    else:
        _writer(asked)(_product(asked, folder), path)
    return path


def _product(asked: Asked, folder: Path) -> Path:
    """The product that the file is made of. Raises StoreError where it is not there."""
    usual = _HEIGHT_PRODUCTS if asked.kind in HEIGHTS else ("ortho",)
    names = (asked.product,) if asked.product else usual
    found = next((path for name in names if (path := folder / "products" / f"{name}.tif").is_file()), None)
    if found is None:
        known = ", ".join(sorted(path.stem for path in (folder / "products").glob("*.tif"))) or "none yet"
        raise StoreError(f"{folder.name} has no product {' or '.join(names)}; --of is one of {known}.")
    return found


def _writer(asked: Asked) -> Callable[[Path, Path], None]:
    # Where they are needed: GDAL and OpenCV take a second to load, and most commands export nothing.
    from orthomill.pipeline.export.conversions.raster_files import write_geotiff, write_picture
    from orthomill.pipeline.export.conversions.relief_files import write_relief
    from orthomill.pipeline.export.conversions.web_tiles import write_tiles

    kind, wanted = asked.kind, asked.wanted
    if kind in MAPS:
        return lambda product, path: write_geotiff(product, path, wanted, cloud=kind == "cog")
    if kind in PICTURES:
        return lambda product, path: write_picture(product, path, wanted, kind)
    if kind in HEIGHTS:
        return lambda product, path: write_relief(product, path, wanted, "hillshade" if kind == "hillshade" else "slope")
    return lambda product, path: write_tiles(product, path, kind)


def _export_cameras(kind: str, path: Path, store: Store) -> None:
    from orthomill.pipeline.export.conversions.camera_files import write_camera_geopackage, write_kml
    from orthomill.schemas.maps.map_page import MAP_PAGE
    from orthomill.schemas.orientation import BLOCK

    if not store.has_table(MAP_PAGE) or not store.has_table(BLOCK):
        raise StoreError(
            "The photographs are exported from what the stage 'viewer' knows of them; add it to the workflow and run it."
        )
    write = write_kml if kind == "kml" else write_camera_geopackage
    path.unlink(missing_ok=True)
    write(path, store.table(BLOCK), store.table(MAP_PAGE).cameras)
