"""The formats of `orthomill export --as`: the command's help, the table in docs/exports.md and the tests are made of this list."""

from dataclasses import dataclass
from typing import Literal

Group = Literal["map", "picture", "relief", "tiles", "layers", "points", "block", "solid", "metadata"]
"""what a format is made of: a product as a raster, as a picture, a product of heights, tiles, photographs and points on the map,
the point cloud, the oriented photographs, the surface in space, the run itself"""


@dataclass(frozen=True)
class ExportFormat:
    """A format by the name that --as takes; `ending` is appended to the name of what is exported; a folder where it has no dot."""

    name: str
    group: Group
    ending: str
    what: str
    opens_in: str
    options: tuple[str, ...] = ()
    """of --of, --crs, --area, --cell, --cutline, --sheets, those that it takes"""
    stem: str = ""
    """name of the file, of what is made of no product"""


_RASTER = ("of", "crs", "area", "cell", "cutline", "sheets")
_TILED = ("of", "cutline")
_SOLID = ("of", "crs", "area", "cell", "cutline")
_CLOUD = ("of", "crs", "area", "cutline")

FORMATS = (
    ExportFormat("geotiff", "map", ".tif", "a product as a tiled GeoTIFF", "QGIS, ArcGIS, CAD, GDAL", _RASTER),
    ExportFormat("cog", "map", ".tif", "the same with overviews, for reading over a network", "QGIS, ArcGIS, GDAL", _RASTER),
    ExportFormat("png", "picture", ".png", "a picture with world file and reference system", "CAD, office programs, QGIS", _RASTER),
    ExportFormat("jpeg", "picture", ".jpg", "the same, smaller, without transparency", "CAD, office programs, QGIS", _RASTER),
    ExportFormat("hillshade", "relief", "_hillshade.tif", "shaded relief of terrain or surface", "QGIS, ArcGIS, CAD", _RASTER),
    ExportFormat("slope", "relief", "_slope.tif", "slope of terrain or surface, degrees", "QGIS, ArcGIS, GDAL", _RASTER),
    ExportFormat("xyz", "tiles", "_tiles", "a folder z/x/y of tiles of the web", "Leaflet, OpenLayers, QGIS", _TILED),
    ExportFormat("mbtiles", "tiles", ".mbtiles", "the same in one SQLite file", "QGIS, GDAL, field apps", _TILED),
    ExportFormat("pmtiles", "tiles", ".pmtiles", "the same in one file for any server", "MapLibre, Leaflet, QGIS", _TILED),
    ExportFormat(
        "laz", "points", ".laz", "the points with their classes, LAS 1.4", "CloudCompare, QGIS, PDAL", (*_CLOUD, "sheets")
    ),
    ExportFormat("copc", "points", ".copc.laz", "the same as an octree in one file", "QGIS, PDAL, web viewers", _CLOUD),
    ExportFormat("ept", "points", "_ept", "the same as a folder of Entwine tiles", "WebODM, Potree, QGIS, PDAL", _CLOUD),
    ExportFormat("cameras", "layers", ".gpkg", "photographs, footprints, control, residuals", "QGIS, ArcGIS", stem="cameras"),
    ExportFormat("kml", "layers", ".kml", "photographs and footprints on the globe", "Google Earth, QGIS", stem="cameras"),
    ExportFormat("glb", "solid", ".glb", "the surface with the orthoimage on it", "Blender, browsers, Office", _SOLID),
    ExportFormat("3dtiles", "solid", "_3dtiles", "the same as 3D Tiles with levels of detail", "Cesium, QGIS, Unreal", _SOLID),
    ExportFormat("colmap", "block", "", "undistorted photographs with a COLMAP project", "COLMAP, splatting", stem="colmap"),
    ExportFormat("openmvs", "block", "", "undistorted photographs with a scene of OpenMVS", "OpenMVS", stem="openmvs"),
    ExportFormat("odm", "block", "", "shots.geojson, cameras.json, geo.txt, control", "OpenDroneMap, WebODM", stem="odm"),
    ExportFormat("metashape", "block", "", "cameras.xml with lens and poses", "Agisoft Metashape", stem="metashape"),
    ExportFormat("pix4d", "block", "", "external and internal parameters, matrices", "Pix4D, SURE, many scripts", stem="pix4d"),
    ExportFormat("stac", "metadata", "_stac.json", "STAC item with checksums", "catalogues, QGIS, pystac", stem="run"),
    ExportFormat("iso19115", "metadata", "_iso19115.xml", "metadata of ISO 19115, with quality", "GeoNetwork", stem="run"),
    ExportFormat("iso19157", "metadata", "_iso19157.xml", "accuracy: tested and promised apart", "GeoNetwork", stem="run"),
    ExportFormat("prov", "metadata", "_prov.json", "which files come from what (PROV-JSON)", "PROV tools, auditors", stem="run"),
)
BY_NAME = {one.name: one for one in FORMATS}


_HEAD = "| format | what | opens in | options |\n| --- | --- | --- | --- |\n"


def with_table(page: str) -> str:
    """The page docs/exports.md with the table of all formats in place of the one that it has."""
    before, _, rest = page.partition(_HEAD)
    _, _, after = rest.partition("\n\n")
    options = {one.name: ", ".join(f"`--{name}`" for name in one.options) for one in FORMATS}
    rows = (f"| `{one.name}` | {one.what} | {one.opens_in} | {options[one.name]} |\n" for one in FORMATS)
    return f"{before}{_HEAD}{''.join(rows)}\n{after}"


def names_in_words() -> str:
    """All names as a sentence, for the help of the command."""
    *others, last = (one.name for one in FORMATS)
    return f"{', '.join(others)} or {last}."
