"""What `orthomill export --as ...` makes of the products of a finished run.

Everything is written in a folder beside its place and moved there when it is whole.
"""

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Protocol

from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.export_formats import BY_NAME, ExportFormat
from orthomill.pipeline.storage.depots.folder import PRODUCTS
from orthomill.pipeline.storage.depots.kept_products import KeptProducts
from orthomill.pipeline.storage.depots.product_files import SHEET_INDEX, SHEETS
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import OrthomillError, ResourceError, StoreError, WorkflowError

if TYPE_CHECKING:
    from orthomill.pipeline.export.block_folder import BlockMethods
    from orthomill.pipeline.export.clouds.cloud_source import CloudSource
    from orthomill.pipeline.export.solids.relief_model import SolidMethods

_PRODUCTS = {
    "map": ("ortho",),
    "picture": ("ortho",),
    "tiles": ("ortho",),
    "relief": ("terrain", "dsm"),
    "points": ("points",),
    "solid": ("dsm",),
}
"""what is exported unless another product is named"""


class Methods(Protocol):
    """Loads the photogrammetry, which only some formats need."""

    def block(self) -> "BlockMethods":
        """What makes the files of other programs."""
        ...

    def solid(self) -> "SolidMethods":
        """What makes models in space."""
        ...


@dataclass(frozen=True)
class Asked:
    """An export as the command line names it: format, product ("ortho"; None: the usual one), how it is warped, where it goes in
    the run's folder (None: products/exported), and the grid of its sheets."""

    kind: str
    product: str | None
    wanted: Wanted
    path: str | None
    sheets: str | None = None


def export_as(asked: Asked, folder: Path, methods: Methods | None = None) -> Path:
    """Makes the file or folder in the run's `folder`; its path. `methods` gives what makes files for other programs.

    Raises WorkflowError, StoreError, and ResourceError where the disk refuses.
    """
    form = BY_NAME.get(asked.kind)
    if form is None:
        raise WorkflowError(f"--as {asked.kind} is not known; formats are {', '.join(BY_NAME)}.")
    _check_options(asked, form)
    product = _product(asked, form, folder)
    ending = SHEETS if asked.sheets else form.ending
    path = folder / (asked.path or f"products/exported/{product.stem if product else form.stem}{ending}")
    if not path.resolve().is_relative_to(folder.resolve()):
        raise WorkflowError(f"{asked.path} is outside the run's folder {folder}; name a path inside it.")
    write = _writer(asked, form, product, folder, methods)
    _written_whole(path, write)
    return path


def _check_options(asked: Asked, form: ExportFormat) -> None:
    given = {"of": asked.product, **vars(asked.wanted), "sheets": asked.sheets}
    if refused := [f"--{name}" for name, value in given.items() if value is not None and name not in form.options]:
        taken = ", ".join(f"--{name}" for name in form.options) or "no option of this kind"
        raise WorkflowError(f"--as {form.name} takes {taken}; leave out {', '.join(refused)}.")


def _product(asked: Asked, form: ExportFormat, folder: Path) -> Path | None:
    """The product that the file is made of; None where it is made of the run. Raises StoreError where it is not there."""
    usual = _PRODUCTS.get(form.group)
    if usual is None:
        return None
    names = (asked.product,) if asked.product else usual
    products = KeptProducts(folder)
    files = _clouds(products.names) if form.group == "points" else products.rasters
    found = next((files[name] for name in names if name in files), None)
    if found is None:
        known = f"--of is one of {', '.join(sorted(files))}" if files else f"run it first: orthomill run {folder.name}"
        raise StoreError(f"{folder.name} has no product {' or '.join(names)}; {known}.")
    return products.brought(found)


def _clouds(names: tuple[str, ...]) -> dict[str, str]:
    """Point clouds by what people call them, of the names of all products."""
    clouds = [PurePosixPath(name) for name in names if name.endswith(".laz")]
    files = {path.stem: str(path) for path in clouds if path.parent.name == PRODUCTS}
    # The points of a large surface are a folder of files.
    folder = f"{PRODUCTS}/points"
    return files | ({"points": folder} if any(str(path.parent) == folder for path in clouds) else {})


def _written_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Lets `write` make the file or folder, and what belongs beside it, in an empty folder, and moves all of it to its place."""
    # Where they are needed: GDAL takes a second to load, and most commands export nothing.
    from lazrs import LazrsError
    from rasterio.errors import RasterioError

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.", suffix=".part") as scratch:
            write(Path(scratch) / path.name)
            for made in sorted(Path(scratch).iterdir()):
                place = path.parent / made.name
                if place.is_dir():
                    shutil.rmtree(place)
                os.replace(made, place)
    except OrthomillError:
        raise
    except (OSError, RasterioError, sqlite3.Error, LazrsError) as error:
        why = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise ResourceError(
            f"{path} cannot be written ({why}); make room on the disk or make the folder writable, then export again."
        ) from error


def _writer(
    asked: Asked, form: ExportFormat, product: Path | None, folder: Path, methods: Methods | None
) -> Callable[[Path], None]:
    if form.group == "block":
        return lambda path: _write_block(form.name, path, Store(folder), methods)
    if form.group == "metadata":
        place = folder / (asked.path or "products/exported/x")
        return lambda path: _write_metadata(form.name, path, folder, place.parent)
    if form.group == "layers":
        return lambda path: _write_layers(form.name, path, Store(folder))
    assert product is not None
    if form.group == "solid":
        return lambda path: _write_solid(form, product, path, asked.wanted, methods)
    if form.group == "points":
        return lambda path: _write_points(form, product, path, asked)
    if asked.sheets:
        return lambda path: _write_sheets(asked, form, product, path)
    return lambda path: _write_product(form, product, path, asked.wanted)


def _write_block(program: str, path: Path, store: Store, methods: Methods | None) -> None:
    from orthomill.pipeline.export.block_folder import write_block

    assert methods is not None
    write_block(path, program, store, methods.block())


def _write_solid(form: ExportFormat, product: Path, path: Path, wanted: Wanted, methods: Methods | None) -> None:
    from orthomill.pipeline.export.solids.height_tiles import height_tiles
    from orthomill.pipeline.export.solids.relief_model import write_glb, write_tileset

    picture = KeptProducts(product.parent.parent).raster("ortho")
    if picture is None:
        raise StoreError(f"{product.parent.parent.name} has no orthoimage to lay on {product.name}.")
    assert methods is not None
    with height_tiles(product, picture, wanted) as tiles:
        (write_glb if form.name == "glb" else write_tileset)(path, tiles, methods.solid())


def _write_points(form: ExportFormat, product: Path, path: Path, asked: Asked) -> None:
    from orthomill.pipeline.export.clouds.cloud_source import cloud_source
    from orthomill.pipeline.export.clouds.copc_file import write_copc
    from orthomill.pipeline.export.clouds.ept_folder import write_ept
    from orthomill.pipeline.export.clouds.laz_file import write_laz

    files = tuple(sorted(product.glob("*.laz"))) if product.is_dir() else (product,)
    source = cloud_source(files, asked.wanted)
    if asked.sheets:
        return _write_point_sheets(path, source, asked)
    {"laz": write_laz, "copc": write_copc, "ept": write_ept}[form.name](path, source)


def _write_point_sheets(path: Path, source: "CloudSource", asked: Asked) -> None:
    from orthomill.pipeline.export.clouds.laz_sheets import write_laz_sheets
    from orthomill.pipeline.export.conversions.map_sheets import sheets_of
    from orthomill.pipeline.export.conversions.sheet_index import write_sheet_index

    path.mkdir()
    written = write_laz_sheets(path, source, sheets_of(asked.sheets or "", source.plan, asked.wanted.area or source.bounds))
    if not written:
        raise WorkflowError(f"--sheets {asked.sheets}: no sheet holds a point.")
    write_sheet_index(path / SHEET_INDEX, written, ".laz", source.plan)


def _write_product(form: ExportFormat, product: Path, path: Path, wanted: Wanted) -> None:
    from orthomill.pipeline.export.conversions.raster_files import write_geotiff, write_picture
    from orthomill.pipeline.export.conversions.relief_files import write_relief
    from orthomill.pipeline.export.conversions.web_tiles import write_tiles

    if form.group == "map":
        write_geotiff(product, path, wanted, cloud=form.name == "cog")
    elif form.group == "picture":
        write_picture(product, path, wanted, form.name)
    elif form.group == "relief":
        write_relief(product, path, wanted, "hillshade" if form.name == "hillshade" else "slope")
    else:
        write_tiles(product, path, form.name, wanted.cutline)


def _write_sheets(asked: Asked, form: ExportFormat, product: Path, path: Path) -> None:
    """A folder with a file for every sheet that has something, and an index of them."""
    from orthomill.pipeline.export.conversions.map_sheets import sheets_of
    from orthomill.pipeline.export.conversions.raster_files import has_something
    from orthomill.pipeline.export.conversions.sheet_index import write_sheet_index
    from orthomill.pipeline.export.conversions.warped_product import warped

    with warped(product, asked.wanted) as view:
        crs, sheets = view.crs and view.wkt, sheets_of(asked.sheets or "", view.wkt, tuple(view.bounds))
    path.mkdir()
    written = []
    for sheet in sheets:
        wanted = replace(asked.wanted, area=sheet.area)
        if has_something(product, wanted):
            _write_product(form, product, path / f"{sheet.name}{form.ending}", wanted)
            written.append(sheet)
    if not written:
        raise WorkflowError(f"--sheets {asked.sheets}: no sheet shows anything of {product.name}.")
    write_sheet_index(path / SHEET_INDEX, written, form.ending, crs)


def _write_metadata(kind: str, path: Path, folder: Path, beside: Path) -> None:
    """The record of the run; `beside`: the folder where it will lie, from which it names the products."""
    from orthomill.pipeline.cli.delivered_record import run_record
    from orthomill.pipeline.export.metadata.delivered_run import delivered_run
    from orthomill.pipeline.export.metadata.iso_metadata import metadata_file
    from orthomill.pipeline.export.metadata.iso_quality import quality_file
    from orthomill.pipeline.export.metadata.provenance_record import provenance_record
    from orthomill.pipeline.export.metadata.stac_item import stac_item

    run = delivered_run(folder, run_record(folder))
    products = Path(os.path.relpath(folder / "products", beside)).as_posix()
    if kind == "stac":
        text = stac_item(run, products)
    elif kind == "iso19115":
        text = metadata_file(run, products)
    else:
        text = quality_file(run) if kind == "iso19157" else provenance_record(run)
    path.write_text(text, encoding="utf-8", newline="\n")


def _write_layers(kind: str, path: Path, store: Store) -> None:
    from orthomill.pipeline.export.conversions.camera_files import MappedBlock, write_camera_geopackage
    from orthomill.pipeline.export.conversions.kml_file import write_kml
    from orthomill.schemas.maps.map_page import MAP_PAGE
    from orthomill.schemas.observations import CONTROL
    from orthomill.schemas.orientation import BLOCK, GROUND_RESIDUALS

    if not store.has_table(MAP_PAGE) or not store.has_table(BLOCK):
        raise StoreError(
            "The photographs are exported from what the stage 'viewer' knows of them; add it to the workflow and run it."
        )
    control = store.table(CONTROL).points if store.has_table(CONTROL) else ()
    residuals = store.table(GROUND_RESIDUALS).points if store.has_table(GROUND_RESIDUALS) else ()
    known = MappedBlock(store.table(BLOCK), store.table(MAP_PAGE).cameras, control, residuals)
    (write_kml if kind == "kml" else write_camera_geopackage)(path, known)
