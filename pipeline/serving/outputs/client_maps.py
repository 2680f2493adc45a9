"""Maps as clients show them: cloud-optimised GeoTIFFs with one band of heights, or colours with their mask, and a plain system.

WebODM refuses maps of a compound system, or of one without an EPSG code. Heights do not change: the plain system leaves out what
they refer to, which the files below `orthomill/` still say. Where there is none stands a number, as OpenDroneMap writes it: WebODM
tells browsers of it in JSON, which has no NaN.
"""

from pathlib import Path

import numpy as np
import rasterio
import rasterio.shutil
from pyproj import CRS

from orthomill.pipeline.export.conversions.raster_files import BLOCK, windows
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.conversions.warped_product import warped

NO_HEIGHT = -9999.0
_TAGS = {
    "driver": "GTiff",
    "tiled": True,
    "blockxsize": BLOCK,
    "blockysize": BLOCK,
    "compress": "deflate",
    "predictor": 1,
    "bigtiff": "if_safer",
}


def plain_system(crs: str) -> str | None:
    """The EPSG code of the plane system of a project, None where it has none."""
    code = CRS.from_user_input(crs).to_2d().to_epsg(min_confidence=70)
    return f"EPSG:{code}" if code else None


def write_client_map(product: Path, path: Path, bands: int, cell: float = 0.0, cutline: Path | None = None) -> str:
    """A product as one map of its first `bands` bands; with a `cell` (units of the system) coarser than its own, averaged to it,
    and within the polygons of a `cutline`. Returns a sentence where the client gets something else than it asked for, or will not
    be able to show the map. Raises WorkflowError for a cutline that does not meet the product."""
    plain = path.with_suffix(".plain.tif")
    path.parent.mkdir(parents=True, exist_ok=True)
    with rasterio.open(product) as source:
        own = abs(source.transform.a)
        system = plain_system(source.crs.to_wkt()) if source.crs else None
    with warped(product, Wanted(cell=cell if cell > 1.001 * own else None, cutline=cutline)) as view:
        kept = min(bands, view.count)
        profile = view.profile | _TAGS | {"count": kept, "crs": system or view.crs}
        heights = profile["nodata"] is not None and np.isnan(profile["nodata"])
        if heights:
            profile["nodata"] = NO_HEIGHT
        with rasterio.open(plain, "w", **profile) as target:
            target.colorinterp = view.view.colorinterp[:kept]
            for window in windows(view.width, view.height):
                values = view.read(window, list(range(1, kept + 1)))
                target.write(np.where(np.isnan(values), values.dtype.type(NO_HEIGHT), values) if heights else values, window=window)
    rasterio.shutil.copy(plain, path, driver="COG", compress="deflate", predictor="yes", overview_resampling="average")
    plain.unlink()
    if system is None:
        return f"{path.name} has a reference system without an EPSG code; WebODM cannot show it: give the option crs."
    if cell and cell < 0.999 * own:
        return f"{path.name}: a cell of {100 * cell:g} cm is finer than what was measured; it has its own of {100 * own:g} cm."
    return ""
