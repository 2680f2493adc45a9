"""Reference systems as the formats of the products hold them, heights included.

A projected system with heights above its ellipsoid (EPSG:32634+4979, as PROJ reads it) has no place of its own in either format:
GDAL would leave it to a file beside a GeoTIFF, and it has no WKT 1. There are ways round:
GeoTIFF: 4979, WGS 84 in three dimensions, as the code of the heights (DGIWG's profile), which GDAL reads as the system that it is.
The heights of other ellipsoids have no such code; they get a vertical system of their own name.
LAS: a vertical datum of the type 2002, ellipsoidal (OGC 01-009, CS_VD_Ellipsoidal), which GDAL, PROJ and PDAL write and read.
"""

import re
from pathlib import Path
from xml.sax.saxutils import escape

import rasterio.shutil
from pyproj import CRS
from pyproj.exceptions import CRSError

_WGS_84 = 4979
_METRE = 'UNIT["metre",1,AUTHORITY["EPSG","9001"]]'


def plan_in_file(crs: str | None) -> str | None:
    """The system that GDAL can write itself: all of it, unless its heights are above the ellipsoid."""
    if crs is None or not _above_ellipsoid(system := CRS.from_user_input(crs)):
        return crs
    return str(system.to_2d().to_wkt())


def geotiff_wkt(crs: str | None) -> str | None:
    """WKT 1 from which GDAL writes the keys of a system with heights above the ellipsoid; None for others."""
    if crs is None or not _above_ellipsoid(system := CRS.from_user_input(crs)):
        return None
    plane, base = _wkt1(system.to_2d()), system.geodetic_crs
    if plane is None or base is None:
        return None
    code = f',AUTHORITY["EPSG","{_WGS_84}"]' if base.to_epsg() == _WGS_84 else ""
    height = f'VERT_CS["{base.name} ellipsoidal height",VERT_DATUM["{base.name} ellipsoid",2005],{_METRE},AXIS["Up",UP]{code}]'
    return _compound(system, plane, height)


def las_wkt(crs: str) -> str:
    """WKT 1, which LAS 1.4 requires, where the system can be expressed in it; otherwise WKT 2. Raises CRSError for unknown ones."""
    system = CRS.from_user_input(crs)
    if _above_ellipsoid(system) and (plane := _wkt1(system.to_2d())):
        height = f'VERT_CS["Ellipsoid (metre)",VERT_DATUM["Ellipsoid",2002],{_METRE},AXIS["Ellipsoidal height",UP]]'
        return _compound(system, plane, height)
    return _wkt1(system) or str(system.to_wkt())


def with_system(plain: Path, wkt: str) -> Path:
    """A virtual file beside a GeoTIFF that has its pixels and the reference system `wkt`: from it GDAL copies both."""
    virtual = plain.with_suffix(".vrt")
    rasterio.shutil.copy(plain, virtual, driver="VRT")
    text = re.sub(r"<SRS.*?</SRS>", lambda _: f"<SRS>{escape(wkt)}</SRS>", virtual.read_text(), count=1, flags=re.DOTALL)
    virtual.write_text(text)
    return virtual


def _above_ellipsoid(system: CRS) -> bool:
    return bool(system.is_projected and not system.is_compound and len(system.axis_info) == 3)


def _compound(system: CRS, plane: str, height: str) -> str:
    return f'COMPD_CS["{system.name} + ellipsoidal height",{plane},{height}]'


def _wkt1(system: CRS) -> str | None:
    """None where a system cannot be expressed in it."""
    try:
        return str(system.to_wkt("WKT1_GDAL"))
    except CRSError:
        return None
