"""Entwine Point Tiles: a folder with a LAZ file for every node of an octree, for WebODM, Potree and QGIS.

Source: Entwine Point Tile format 1.1 (entwine.io).
"""

import json
import tempfile
from pathlib import Path
from typing import Any

import laspy
from pyproj import CRS

from orthomill.pipeline.export.clouds.cloud_source import CloudSource, as_points, nothing_there
from orthomill.pipeline.export.clouds.copc_file import check_metric
from orthomill.pipeline.export.clouds.point_octree import SPAN_BITS, PointOctree

_NAMES = {"gps_time": "GpsTime", "point_source_id": "PointSourceId", "user_data": "UserData", "scan_angle": "ScanAngleRank"}
"""dimensions whose names there are not made of those of LAS by capitals alone, or only nearly"""


def write_ept(path: Path, source: CloudSource) -> None:
    """The points as a folder at `path`. Raises WorkflowError where there are none, or where the system has degrees."""
    header = source.header
    check_metric(header)
    for name in ("ept-data", "ept-hierarchy"):
        (path / name).mkdir(parents=True)
    hierarchy = {}
    with tempfile.TemporaryDirectory(dir=path.parent, suffix=".part") as scratch:
        tree = PointOctree(source.parts(), Path(scratch))
        if not tree.count:
            raise nothing_there()
        for key, records in tree.nodes():
            name = "-".join(map(str, key))
            file = path / "ept-data" / f"{name}.laz"
            with laspy.open(file, "w", header=header, do_compress=True, laz_backend=laspy.LazBackend.Lazrs) as target:
                target.write_points(as_points(header, records))
            hierarchy[name] = len(records)
    (path / "ept-hierarchy" / "0-0-0-0.json").write_text(json.dumps(hierarchy, indent=1))
    (path / "ept.json").write_text(json.dumps(_about(tree, header), indent=1))


def _about(tree: PointOctree, header: laspy.LasHeader) -> dict[str, Any]:
    def metres(steps: Any) -> list[float]:
        return [round(float(value), 6) for value in header.offsets + steps * header.scales]

    crs = header.parse_crs()
    assert crs is not None
    return {
        "bounds": metres(tree.cube.low) + metres(tree.cube.low + 2**tree.cube.bits),
        "boundsConforming": metres(tree.low) + metres(tree.high),
        "dataType": "laszip",
        "hierarchyType": "json",
        "points": tree.count,
        "schema": list(_schema(header)),
        "span": 1 << SPAN_BITS,
        "srs": _system(crs),
        "version": "1.1.0",
    }


def _system(crs: CRS) -> dict[str, str]:
    plan = crs.sub_crs_list[0] if crs.is_compound else crs
    code = plan.to_authority()
    return {**({"authority": code[0], "horizontal": code[1]} if code else {}), "wkt": crs.to_wkt("WKT1_GDAL")}


def _schema(header: laspy.LasHeader) -> list[dict[str, Any]]:
    kinds = {"u": "unsigned", "i": "signed", "f": "float"}
    dimensions = []
    for one in header.point_format.dimensions:
        kind = kinds.get(one.dtype.kind, "unsigned") if one.dtype is not None else "unsigned"
        name = one.name if one.name in "XYZ" or not one.is_standard else _NAMES.get(one.name, one.name.title().replace("_", ""))
        entry = {"name": name, "type": kind, "size": max(one.num_bits // 8, 1)}
        if one.name in "XYZ":
            axis = "XYZ".index(one.name)
            entry |= {"scale": float(header.scales[axis]), "offset": float(header.offsets[axis])}
        dimensions.append(entry)
    return dimensions
