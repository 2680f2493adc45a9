"""Planned points for the field: GeoJSON for maps, GPX for receivers and telephones, both in degrees of WGS 84."""

import json
from collections.abc import Sequence
from xml.sax.saxutils import escape

from pyproj import CRS, Transformer

from orthomill.schemas.marks import NextPoint

GEOJSON, GPX = "next_points.geojson", "next_points.gpx"


def next_point_files(points: Sequence[NextPoint], crs: str) -> dict[str, str]:
    """The texts of both files, by their names; `crs`: system of the coordinates."""
    plan = CRS.from_user_input(crs.split("+")[0])
    to_degrees = Transformer.from_crs(plan, "EPSG:4326", always_xy=True)
    placed = [(f"{one.role}{n}", one, *to_degrees.transform(*one.xyz[:2])) for n, one in enumerate(points, 1)]
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [round(lon, 8), round(lat, 8)]},
            "properties": {"name": name, "role": one.role, "photographs": one.photographs, "sentence": next_sentence(one)},
        }
        for name, one, lon, lat in placed
    ]
    waypoints = "".join(
        f'<wpt lat="{lat:.8f}" lon="{lon:.8f}"><name>{escape(name)}</name><desc>{escape(next_sentence(one))}</desc></wpt>\n'
        for name, one, lon, lat in placed
    )
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="orthomill" xmlns="http://www.topografix.com/GPX/1/1">\n'
    return {GEOJSON: json.dumps({"type": "FeatureCollection", "features": features}, indent=1), GPX: f"{head}{waypoints}</gpx>\n"}


def next_sentence(one: NextPoint) -> str:
    """What a point there is good for."""
    x, y, _ = one.xyz
    where = f"{x:.1f}, {y:.1f}, seen by {one.photographs} photographs"
    if one.role == "check":
        return f"A check point at {where}: there the standard error stays largest, {one.before:.3f} m."
    return f"A control point at {where}: the largest standard error on the ground falls from {one.before:.3f} to {one.after:.3f} m."
