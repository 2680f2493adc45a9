"""Where the photographs were taken and what they show: GeoPackage and KML."""

from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from orthomill.pipeline.export.vectors.geojson import to_degrees
from orthomill.pipeline.export.vectors.geopackage import write_geopackage
from orthomill.pipeline.export.vectors.map_features import Feature, Layer
from orthomill.schemas.maps.map_page import MapCamera
from orthomill.schemas.orientation import Block


def write_camera_geopackage(path: Path, block: Block, cameras: tuple[MapCamera, ...]) -> None:
    """Projection centres with their standard errors and angles (degrees), and footprints at the mean height of the ground."""
    centres, footprints = [], []
    for camera in cameras:
        oriented = block.of(camera.name)
        sigma = np.sqrt(np.diag(oriented.covariance)[:3]) if oriented.covariance is not None else [None] * 3
        known = dict(
            zip(("sigma_x", "sigma_y", "sigma_z"), (None if s is None else round(float(s), 4) for s in sigma), strict=True)
        )
        about = {"photograph": camera.name, "taken": camera.taken}
        centres.append(Feature(np.array([camera.centre]), {**about, **known}))
        if camera.outline:
            ring = np.array([(*place, block.ground_mean) for place in (*camera.outline, camera.outline[0])])
            footprints.append(Feature(ring, dict(about)))
    layers = (Layer("cameras", "point", tuple(centres)), Layer("footprints", "area", tuple(footprints)))
    write_geopackage(path, layers, block.crs)


def write_kml(path: Path, block: Block, cameras: tuple[MapCamera, ...]) -> None:
    """Projection centres and footprints, for programs with a globe."""
    change = to_degrees(block.crs)
    parts = []
    for camera in cameras:
        x, y, z = camera.centre
        lon, lat = change.transform(x, y) if change else (x, y)
        ring = [change.transform(*place) if change else place for place in (*camera.outline, *camera.outline[:1])]
        outline = " ".join(f"{a:.8f},{b:.8f},0" for a, b in ring)
        polygon = (
            f"<Polygon><outerBoundaryIs><LinearRing><coordinates>{outline}</coordinates></LinearRing></outerBoundaryIs></Polygon>"
        )
        point = f"<Point><altitudeMode>absolute</altitudeMode><coordinates>{lon:.8f},{lat:.8f},{z:.3f}</coordinates></Point>"
        when = f"<TimeStamp><when>{escape(camera.taken)}</when></TimeStamp>" if camera.taken else ""
        shapes = f"<MultiGeometry>{point}{polygon if ring else ''}</MultiGeometry>"
        parts.append(f"<Placemark><name>{escape(camera.name)}</name>{when}<styleUrl>#p</styleUrl>{shapes}</Placemark>")
    style = '<Style id="p"><LineStyle><color>ff8b6f1f</color></LineStyle><PolyStyle><fill>0</fill></PolyStyle></Style>'
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
    path.write_text(head + style + "\n".join(parts) + "</Document></kml>\n", encoding="utf-8")
