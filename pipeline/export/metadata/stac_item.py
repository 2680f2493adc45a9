"""A STAC item of the run: its products as assets, with projection, bands, size and checksum.

Source: STAC 1.1.0; extensions projection 2.0.0, raster 2.0.0 and file 2.1.0 (checksum: multihash of SHA-256).
"""

import json
from typing import Any

from orthomill.pipeline.export.metadata.delivered_run import DeliveredFile, DeliveredRun, MapFacts
from orthomill.pipeline.storage.features.outline_files import PIECES

_EXTENSIONS = [
    "https://stac-extensions.github.io/projection/v2.0.0/schema.json",
    "https://stac-extensions.github.io/raster/v2.0.0/schema.json",
    "https://stac-extensions.github.io/file/v2.1.0/schema.json",
]
_SHA256 = "1220"
"""multihash: SHA2-256, 32 bytes"""
_DECIMALS = 8
"""of degrees: a millimetre"""
_NO_TIME = "of the run, for the photographs have no time"
_DATA = ("ortho.tif", "ortho.vrt", "dsm.tif", "dsm.vrt", "terrain.tif", "terrain.vrt", "points.laz")


def stac_item(run: DeliveredRun, products: str) -> str:
    """The item as JSON; `products`: their folder as seen from the item."""
    properties: dict[str, Any] = {"created": _utc(run.record.started), "updated": _utc(run.record.finished)}
    if run.taken is None:
        properties |= {"datetime": _utc(run.record.finished), "orthomill:datetime": _NO_TIME}
    else:
        first, last = run.taken
        properties |= {"datetime": first} if first == last else {"datetime": None, "start_datetime": first, "end_datetime": last}
    properties |= {
        "processing:software": {"orthomill": run.record.version},
        "orthomill:accuracy": run.statement.level,
        "orthomill:statements": [figure.sentence for figure in run.statement.figures],
    }
    ring = [[round(value, _DECIMALS) for value in place] for place in run.outline[::PIECES].tolist()]
    item = {
        "type": "Feature",
        "stac_version": "1.1.0",
        "stac_extensions": _EXTENSIONS,
        "id": run.record.project,
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        "bbox": [round(value, _DECIMALS) for value in run.box],
        "properties": properties,
        "links": [],
        "assets": {one.name: _asset(one, products) for one in run.files},
    }
    return json.dumps(item, indent=1, allow_nan=False) + "\n"


def _utc(time: str) -> str:
    """RFC 3339 with Z."""
    return time.replace("+0000", "Z").replace("+00:00", "Z")


def _asset(one: DeliveredFile, products: str) -> dict[str, Any]:
    asset: dict[str, Any] = {
        "href": f"{products}/{one.name}",
        "type": one.media,
        "roles": ["data"] if one.name in _DATA else ["metadata"] if one.media == "application/json" else ["data", "auxiliary"],
        "file:size": one.size,
        "file:checksum": _SHA256 + one.sha256,
    }
    if one.purpose:
        asset["description"] = one.purpose
    return asset | (_map(one.map) if one.map else {})


def _map(facts: MapFacts) -> dict[str, Any]:
    a, b, c, d, e, f = facts.transform
    known: dict[str, Any] = {
        "proj:code": f"EPSG:{facts.epsg}" if facts.epsg else None,
        "proj:transform": [a, b, c, d, e, f],
        "proj:shape": list(facts.shape),
        "proj:bbox": list(facts.bounds),
        "raster:spatial_resolution": abs(a),
    }
    if not facts.epsg:
        known["proj:wkt2"] = facts.wkt
    nodata = None if facts.nodata is None else "nan" if facts.nodata != facts.nodata else facts.nodata
    bands = []
    for name, unit, dtype in facts.bands:
        band: dict[str, Any] = {"data_type": dtype}
        band |= {key: value for key, value in (("name", name), ("unit", unit), ("nodata", nodata)) if value not in (None, "")}
        bands.append(band)
    return {**known, "bands": bands}
