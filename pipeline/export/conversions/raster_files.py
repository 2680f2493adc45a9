"""Products as GeoTIFF, cloud-optimised GeoTIFF, or pictures with a world file."""

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import rasterio
import rasterio.shutil
from pyproj import CRS
from rasterio.windows import Window

from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.conversions.warped_product import WarpedProduct, plan_of, warped
from orthomill.pipeline.export.exports import world_file
from orthomill.schemas.errors import WorkflowError

BLOCK = 512
"""px along the blocks that are written"""
_TAGS = {"compress": "deflate", "predictor": 2, "tiled": True, "blockxsize": BLOCK, "blockysize": BLOCK, "bigtiff": "if_safer"}
_PICTURE_SUFFIXES = {"png": ".pgw", "jpeg": ".jgw"}
"""of the world file"""
_MOST_PICTURE = 65_500
"""px along a side that JPEG can hold"""


def windows(width: int, height: int) -> Iterator[Window]:
    """Blocks that cover a file, row by row."""
    for top in range(0, height, BLOCK):
        for left in range(0, width, BLOCK):
            yield Window(left, top, min(BLOCK, width - left), min(BLOCK, height - top))


def has_something(product: Path, wanted: Wanted) -> bool:
    """Whether the product shows anything there."""
    with warped(product, wanted) as view:
        return any(view.seen(window).any() for window in windows(view.width, view.height))


def write_geotiff(product: Path, path: Path, wanted: Wanted, cloud: bool) -> None:
    """The product as a tiled GeoTIFF, with overviews where it is for the `cloud`."""
    plain = path.with_suffix(".plain.tif") if cloud else path
    with warped(product, wanted) as view:
        predictor = 3 if np.dtype(view.dtypes[0]).kind == "f" else 2
        profile = view.profile | _TAGS | {"driver": "GTiff", "predictor": predictor}
        with rasterio.open(plain, "w", **profile) as target:
            known = view.view
            target.colorinterp, target.descriptions, target.units = known.colorinterp, known.descriptions, known.units
            for window in windows(view.width, view.height):
                target.write(view.read(window), window=window)
        codes = view.count == 1 and np.dtype(view.dtypes[0]).kind == "u"
    if cloud:
        averaging = "nearest" if codes else "average"
        rasterio.shutil.copy(plain, path, driver="COG", compress="deflate", predictor="yes", overview_resampling=averaging)
        plain.unlink()


def write_picture(product: Path, path: Path, wanted: Wanted, kind: str) -> None:
    """The product as PNG or JPEG with a world file and its reference system beside it. Raises WorkflowError for what is no
    picture."""
    with warped(product, wanted) as view:
        if view.dtypes[0] != "uint8" or view.count < 3:
            raise WorkflowError(f"{product.name} is no picture of 8 bits; ask for --as geotiff, or for --as hillshade of heights.")
        if kind == "jpeg" and max(view.width, view.height) > _MOST_PICTURE:
            raise WorkflowError(
                f"JPEG holds {_MOST_PICTURE} px along a side; give a larger --cell, a smaller --area, or --as geotiff."
            )
        bands = [1, 2, 3] if kind == "jpeg" else list(range(1, view.count + 1))
        plain = path.with_suffix(".plain.tif")
        profile = view.profile | _TAGS | {"driver": "GTiff", "count": len(bands), "photometric": "rgb", "nodata": None}
        with rasterio.open(plain, "w", **profile) as target:
            for window in windows(view.width, view.height):
                target.write(view.read(window, bands), window=window)
        rasterio.shutil.copy(plain, path, driver=kind.upper(), **({"quality": 90} if kind == "jpeg" else {}))
        plain.unlink()
        path.with_name(f"{path.name}.aux.xml").unlink(missing_ok=True)
        path.with_suffix(_PICTURE_SUFFIXES[kind]).write_text(world_file(tuple(view.transform)[:6]))
        if view.crs is not None:
            _write_system(path, plan_of(CRS.from_user_input(view.crs)))


def _write_system(path: Path, system: CRS) -> None:
    """The reference system beside a picture: .prj for CAD, .aux.xml for GDAL, QGIS and ArcGIS, which read no .prj of a picture."""
    path.with_suffix(".prj").write_text(system.to_wkt("WKT1_ESRI"))
    told = escape(system.to_wkt("WKT1_GDAL"))
    path.with_name(f"{path.name}.aux.xml").write_text(f"<PAMDataset>\n  <SRS>{told}</SRS>\n</PAMDataset>\n")


def height_windows(view: WarpedProduct) -> Iterator[tuple[Window, np.ndarray, tuple[slice, slice]]]:
    """Blocks with their heights (rows, cols), NaN in gaps, and a cell more on every side, and the place of the block in these."""
    for window in windows(view.width, view.height):
        left, top = max(window.col_off - 1, 0), max(window.row_off - 1, 0)
        right = min(window.col_off + window.width + 1, view.width)
        bottom = min(window.row_off + window.height + 1, view.height)
        wider = Window(left, top, right - left, bottom - top)
        values = np.where(view.seen(wider), view.read(wider, [1])[0].astype(np.float64), np.nan)
        inner = np.s_[
            window.row_off - top : window.row_off - top + window.height,
            window.col_off - left : window.col_off - left + window.width,
        ]
        yield window, values, inner
