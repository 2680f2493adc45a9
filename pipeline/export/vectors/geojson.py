"""Features as GeoJSON, in longitude and latitude as its standard asks; on a plane of its own in X and Y.

Source: RFC 7946.
"""

import json
from collections.abc import Iterable
from typing import TextIO

import numpy as np
from pyproj import CRS, Transformer

from orthomill.pipeline.export.vectors.map_features import Feature, Layer

_DEGREES, _METRES = 8, 3
"""decimals: a millimetre, in either"""


def write_geojson(target: TextIO, layers: Iterable[Layer], crs: str | None) -> None:
    """All features in one collection; a feature has the name of its layer as an attribute where there are several layers."""
    many = len(layers := tuple(layers)) > 1
    change = to_degrees(crs)
    target.write('{"type": "FeatureCollection", "features": [')
    first = True
    for layer in layers:
        for feature in layer.features:
            properties = {"layer": layer.name, **feature.attributes} if many else feature.attributes
            item = {"type": "Feature", "geometry": _geometry(feature, layer.kind, change), "properties": properties}
            target.write(("\n" if first else ",\n") + json.dumps(item))
            first = False
    target.write("\n]}\n")


def to_degrees(crs: str | None) -> Transformer | None:
    """From a system in plan to longitude and latitude (WGS 84); None where positions are not on the Earth."""
    system = CRS.from_user_input(crs) if crs is not None else None
    if system is None or not (system.is_projected or system.is_geographic or system.is_compound):
        return None
    plane = system.sub_crs_list[0] if system.is_compound else system.to_2d()
    return Transformer.from_crs(plane, CRS.from_epsg(4326), always_xy=True)


def _geometry(feature: Feature, kind: str, change: Transformer | None) -> dict[str, object]:
    rings = [_coordinates(places, change) for places in (feature.places, *feature.holes)]
    if kind == "point":
        return {"type": "Point", "coordinates": rings[0][0]}
    return {"type": "LineString", "coordinates": rings[0]} if kind == "line" else {"type": "Polygon", "coordinates": rings}


def _coordinates(places: np.ndarray, change: Transformer | None) -> list[list[float]]:
    x, y = (places[:, 0], places[:, 1]) if change is None else change.transform(places[:, 0], places[:, 1])
    digits = _METRES if change is None else _DEGREES
    columns = (np.round(x, digits), np.round(y, digits), np.round(places[:, 2], _METRES))
    rows: list[list[float]] = np.column_stack(columns).tolist()
    return rows
