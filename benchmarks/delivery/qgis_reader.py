"""Products in QGIS without a window, run by the Python that has it: `python3 qgis_reader.py PRODUCTS PICTURE`.

Opens every map, cloud and drawing of a folder as a layer, prints what QGIS says of each as JSON, and draws the orthoimage with its
contours into a picture. Nothing of orthomill is imported, for QGIS lives in the system's Python.
"""

import json
import os
import sys
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.core import (
    QgsApplication,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsPointCloudLayer,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor

RASTERS, VECTORS, CLOUDS = {".tif", ".jpg", ".png", ".mbtiles"}, {".gpkg", ".geojson", ".dxf", ".kml"}, {".laz"}
SIDE = 1400


def layers(folder: Path):
    """(file, kind, layer) of all that QGIS should know."""
    for path in sorted(folder.rglob("*")):
        suffix, name = path.suffix.lower(), path.relative_to(folder).as_posix()
        if "viewer" in path.parts or not path.is_file():
            continue
        if suffix in RASTERS:
            yield name, "raster", QgsRasterLayer(str(path), name)
        elif suffix in VECTORS:
            yield name, "vector", QgsVectorLayer(str(path), name, "ogr")
        elif suffix in CLOUDS and "pdal" in QgsProviderRegistry.instance().providerList():
            yield name, "cloud", QgsPointCloudLayer(str(path), name, "pdal")


def told(name: str, kind: str, layer) -> dict:
    """What QGIS says of a layer."""
    found = {"file": name, "kind": kind, "valid": layer.isValid(), "crs": layer.crs().authid() or layer.crs().description()}
    if not layer.isValid():
        return found
    if kind == "raster":
        found["size"] = f"{layer.width()} x {layer.height()}, {layer.bandCount()} bands"
    elif kind == "vector":
        parts = layer.dataProvider().subLayers()
        found["size"] = f"{layer.featureCount()} features" + (f", {len(parts)} layers" if len(parts) > 1 else "")
    else:
        found["size"] = f"{layer.pointCount()} points"
    return found


def draw(folder: Path, picture: Path) -> None:
    """Contours over the orthoimage, over the whole of it."""
    ortho = QgsRasterLayer(str(folder / "ortho.tif"), "ortho")
    contours = QgsVectorLayer(str(folder / "contours.gpkg"), "contours", "ogr")
    contours.renderer().symbol().setColor(QColor(255, 220, 60))
    settings = QgsMapSettings()
    settings.setLayers([contours, ortho])
    settings.setDestinationCrs(ortho.crs())
    settings.setBackgroundColor(QColor(255, 255, 255))
    settings.setOutputSize(QSize(SIDE, SIDE))
    settings.setExtent(ortho.extent())
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    job.renderedImage().save(str(picture), "JPG", 88)


def main() -> None:
    """Opens, prints and draws."""
    folder, picture = map(Path, sys.argv[1:3])
    application = QgsApplication([], False)
    application.initQgis()
    found = [told(*layer) for layer in layers(folder)]
    draw(folder, picture)
    print(json.dumps({"version": str(getattr(__import__("qgis.core").core.Qgis, "QGIS_VERSION", "")), "layers": found}))
    sys.stdout.flush()
    # QGIS tears its layers down in an order of its own, and may crash there.
    os._exit(0)


if __name__ == "__main__":
    main()
