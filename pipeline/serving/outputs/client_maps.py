"""Maps as clients show them: cloud-optimised GeoTIFFs with one band of heights, or colours with their mask, and a plain system.

WebODM refuses maps of a compound system, or of one without an EPSG code. Heights do not change: the plain system leaves out what
they refer to, which the files below `orthomill/` still say.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rasterio
import rasterio.shutil
from pyproj import CRS
from rasterio.io import DatasetReader
from rasterio.vrt import WarpedVRT

from orthomill.pipeline.export.conversions.raster_files import BLOCK, windows
from orthomill.pipeline.export.conversions.warped_product import Wanted, warped


def plain_system(crs: str) -> str | None:
    """The EPSG code of the plane system of a project, None where it has none."""
    code = CRS.from_user_input(crs).to_2d().to_epsg(min_confidence=70)
    return f"EPSG:{code}" if code else None


def write_client_map(product: Path, path: Path, bands: int, cell: float = 0.0) -> str:
    """A product as one map of its first `bands` bands; with a `cell` (units of the system) coarser than its own, averaged to it.
    Returns a sentence where the client gets something else than it asked for, or will not be able to show the map."""
    plain, said = path.with_suffix(".plain.tif"), ""
    path.parent.mkdir(parents=True, exist_ok=True)
    with rasterio.open(product) as source:
        own = abs(source.transform.a)
        system = plain_system(source.crs.to_wkt()) if source.crs else None
    if system is None:
        said = f"{path.name} has a reference system without an EPSG code; WebODM cannot show it: give the option crs."
    elif cell and cell < 0.999 * own:
        said = f"{path.name}: a cell of {100 * cell:g} cm is finer than what was measured; it has its own of {100 * own:g} cm."
    with _opened(product, cell if cell > 1.001 * own else 0.0) as view:
        kept = min(bands, view.count)
        profile = {
            "driver": "GTiff",
            "width": view.width,
            "height": view.height,
            "count": kept,
            "dtype": view.dtypes[0],
            "crs": system or view.crs,
            "transform": view.transform,
            "nodata": view.nodata,
            "tiled": True,
            "blockxsize": BLOCK,
            "blockysize": BLOCK,
            "compress": "deflate",
            "bigtiff": "if_safer",
        }
        with rasterio.open(plain, "w", **profile) as target:
            target.colorinterp = view.colorinterp[:kept]
            for window in windows(view.width, view.height):
                target.write(view.read(list(range(1, kept + 1)), window=window), window=window)
        averaging = "average" if np.dtype(view.dtypes[0]).kind == "f" or kept > 1 else "nearest"
    rasterio.shutil.copy(plain, path, driver="COG", compress="deflate", predictor="yes", overview_resampling=averaging)
    plain.unlink()
    return said


@contextmanager
def _opened(product: Path, cell: float) -> Iterator[DatasetReader | WarpedVRT]:
    """The product, with another cell where one is given."""
    if cell:
        with warped(product, Wanted(cell=cell)) as view:
            yield view
        return
    with rasterio.open(product) as source:
        yield source
