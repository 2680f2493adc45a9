"""Photographs, footprints and surveyed points for programs with a globe.

Source: OGC 12-007r2, KML 2.3. Heights are given as they are; programs take them as heights above the sea.
"""

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

from pyproj import Transformer

from orthomill.pipeline.export.conversions.camera_files import MappedBlock
from orthomill.pipeline.export.vectors.geojson import to_degrees
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.maps.map_page import MapCamera

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document>
<Style id="photograph"><LineStyle><color>ff8b6f1f</color></LineStyle><PolyStyle><fill>0</fill></PolyStyle></Style>
<Style id="control"><IconStyle><color>ff3c6ee0</color></IconStyle></Style>
<Style id="check"><IconStyle><color>ff7a9b3f</color></IconStyle></Style>
"""


def write_kml(path: Path, known: MappedBlock) -> None:
    """A file at `path`. Raises WorkflowError for a block that lies nowhere on the earth."""
    change = to_degrees(known.block.crs)
    if change is None:
        raise WorkflowError("KML shows a place on the earth, and this block has none; ask for --as cameras.")
    folders = (("photographs", _photographs(known, change)), ("surveyed points", _surveyed(known, change)))
    parts = (f"<Folder><name>{name}</name>\n{''.join(marks)}</Folder>\n" for name, marks in folders)
    path.write_text(f"{_HEAD}{''.join(parts)}</Document></kml>\n", encoding="utf-8", newline="\n")


def _photographs(known: MappedBlock, change: Transformer) -> Iterator[str]:
    for camera in known.cameras:
        when = f"<TimeStamp><when>{escape(camera.taken)}</when></TimeStamp>" if camera.taken else ""
        shapes = f"<MultiGeometry>{_point(camera.centre, change)}{_outline(camera, change)}</MultiGeometry>"
        yield f"<Placemark><name>{escape(camera.name)}</name>{when}<styleUrl>#photograph</styleUrl>{shapes}</Placemark>\n"


def _surveyed(known: MappedBlock, change: Transformer) -> Iterator[str]:
    found = {(one.role, one.name): one for one in known.residuals}
    for point in known.control:
        # A tie point has no coordinates of its own.
        if point.role == "tie":
            continue
        words = point.role
        if residual := found.get((point.role, point.name)):
            x, y, z = residual.difference
            words += f"; block minus survey: X {x:+.3f} m, Y {y:+.3f} m, Z {z:+.3f} m"
        about = f"<name>{escape(point.name)}</name><description>{escape(words)}</description><styleUrl>#{point.role}</styleUrl>"
        yield f"<Placemark>{about}{_point(point.xyz, change)}</Placemark>\n"


def _point(place: tuple[float, float, float], change: Transformer) -> str:
    x, y, z = place
    lon, lat = change.transform(x, y)
    return f"<Point><altitudeMode>absolute</altitudeMode><coordinates>{lon:.8f},{lat:.8f},{z:.3f}</coordinates></Point>"


def _outline(camera: MapCamera, change: Transformer) -> str:
    if not camera.outline:
        return ""
    ring = (change.transform(*place) for place in (*camera.outline, camera.outline[0]))
    places = " ".join(f"{lon:.8f},{lat:.8f},0" for lon, lat in ring)
    return f"<Polygon><outerBoundaryIs><LinearRing><coordinates>{places}</coordinates></LinearRing></outerBoundaryIs></Polygon>"
