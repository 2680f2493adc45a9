"""Points, lines and polygons that a user has drawn, from GeoPackage, GeoJSON or CSV, in the project's system.

Source: OGC 12-128r19, GeoPackage Encoding Standard 1.4, clause 2.1.3 (geometry BLOBs); OGC 06-103r4 for well-known binary; RFC
7946.
"""

import csv
import json
import math
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from orthomill.schemas.accuracy.surface_answers import DrawnFeature, FeatureKind
from orthomill.schemas.errors import WorkflowError

_ENVELOPES = (0, 32, 48, 48, 64)
"""bytes of an envelope, by its kind"""
_NAMES = ("name", "label", "id", "fid")
_KINDS: dict[str, FeatureKind] = {"Point": "point", "LineString": "line", "Polygon": "polygon"}


def read_features(path: Path, crs: str) -> tuple[DrawnFeature, ...]:
    """All features of a file in the plan system `crs`. Raises WorkflowError for what cannot be read or holds none."""
    readers = {".gpkg": _of_geopackage, ".geojson": _of_geojson, ".json": _of_geojson, ".csv": _of_csv, ".txt": _of_csv}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise WorkflowError(f"{path} is no file of features that can be read; give .gpkg, .geojson or .csv (name,x,y).")
    if not path.is_file():
        raise WorkflowError(f"There is no file {path}.")
    try:
        found = tuple(_moved(feature, system, crs) for feature, system in reader(path))
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, IndexError, struct.error, sqlite3.Error) as error:
        raise WorkflowError(f"{path} cannot be read ({error}); export the features as GeoPackage or GeoJSON again.") from error
    except CRSError as error:
        raise WorkflowError(f"{path}: its reference system is not known ({error}).") from error
    if not found:
        raise WorkflowError(f"{path} holds no points, lines or polygons.")
    for feature in found:
        if not np.isfinite(feature.places).all() or len(feature.places) < {"point": 1, "line": 2, "polygon": 3}[feature.kind]:
            raise WorkflowError(f"{path}: {feature.name} is no {feature.kind}; it has {len(feature.places)} places.")
    return found


def _moved(feature: DrawnFeature, system: str | None, crs: str) -> DrawnFeature:
    """The feature in another system."""
    own, target = CRS.from_user_input(system or crs), CRS.from_user_input(crs)
    if system is None or own == target:
        return feature
    plan = target.sub_crs_list[0] if target.is_compound else target
    x, y = Transformer.from_crs(own, plan, always_xy=True).transform(feature.places[:, 0], feature.places[:, 1])
    return DrawnFeature(feature.name, feature.kind, np.column_stack([x, y]))


def _feature(name: str, kind: FeatureKind, places: Any) -> DrawnFeature:
    found = np.array(places, np.float64).reshape(-1, np.shape(places)[-1])[:, :2]
    if kind == "polygon" and len(found) > 1 and np.array_equal(found[0], found[-1]):
        found = found[:-1]
    return DrawnFeature(name, kind, found)


def _of_csv(path: Path) -> Iterator[tuple[DrawnFeature, str | None]]:
    for number, row in enumerate(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()), 1):
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#") or (number == 1 and not _is_number(cells[-1])):
            continue
        if len(cells) not in (2, 3) or not all(map(_is_number, cells[-2:])):
            raise ValueError(f"line {number} is not name,x,y")
        name = cells[0] if len(cells) == 3 else str(number)
        yield _feature(name, "point", [[float(cells[-2]), float(cells[-1])]]), None


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _of_geojson(path: Path) -> Iterator[tuple[DrawnFeature, str | None]]:
    whole = json.loads(path.read_text(encoding="utf-8-sig"))
    named = ((whole.get("crs") or {}).get("properties") or {}).get("name")
    # RFC 7946 knows longitude and latitude only; what QGIS and GDAL write beside it names its system.
    system = named or "EPSG:4326"
    for number, item in enumerate(whole.get("features", [whole]), 1):
        geometry, known = item.get("geometry", item), item.get("properties") or {}
        name = next((str(known[key]) for key in _NAMES if known.get(key) is not None), str(number))
        for kind, places in _parts(geometry["type"], geometry["coordinates"]):
            yield _feature(name, kind, places), system


def _parts(kind: str, places: Any) -> Iterator[tuple[FeatureKind, Any]]:
    """Single geometries; of polygons the outer ring."""
    if kind.startswith("Multi"):
        for one in places:
            yield from _parts(kind.removeprefix("Multi"), one)
    elif kind not in _KINDS:
        raise ValueError(f"geometries of kind {kind} are not measured")
    elif kind == "Polygon":
        if len(places) > 1:
            raise ValueError("polygons with holes are not measured; draw hole and outline as polygons of their own")
        yield "polygon", places[0]
    else:
        yield _KINDS[kind], [places] if kind == "Point" else places


def _of_geopackage(path: Path) -> Iterator[tuple[DrawnFeature, str | None]]:
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
        layers = database.execute(
            "SELECT g.table_name, g.column_name, s.organization, s.organization_coordsys_id, s.definition FROM "
            "gpkg_geometry_columns g LEFT JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id"
        ).fetchall()
        for table, column, authority, code, definition in layers:
            system = f"EPSG:{code}" if str(authority).upper() == "EPSG" else definition
            # A name of a table cannot be a parameter; quoted, it can be nothing else than a name.
            rows = database.execute('SELECT * FROM "' + table.replace('"', '""') + '"')  # noqa: S608
            heads = [head[0] for head in rows.description]
            for number, row in enumerate(rows, 1):
                values = dict(zip(heads, row, strict=True))
                folded = {head.casefold(): values[head] for head in heads if head != column}
                name = next((str(folded[key]) for key in _NAMES if folded.get(key) is not None), str(number))
                for kind, places in _of_blob(values[column]):
                    yield _feature(name, kind, places), system


def _of_blob(blob: bytes | None) -> Iterator[tuple[FeatureKind, Any]]:
    if not blob or blob[:2] != b"GP":
        return
    flags = blob[3]
    wkb, at = blob, 8 + _ENVELOPES[(flags >> 1) & 7]
    kind, places, _ = _of_wkb(wkb, at)
    yield from _parts(kind, places)


_NUMBERS = {1: "Point", 2: "LineString", 3: "Polygon", 4: "MultiPoint", 5: "MultiLineString", 6: "MultiPolygon"}


def _of_wkb(data: bytes, at: int) -> tuple[str, Any, int]:
    """Kind, coordinates as in GeoJSON, and where the geometry ends."""
    order = "<" if data[at] == 1 else ">"
    (code,) = struct.unpack_from(order + "I", data, at + 1)
    size = 2 + (code // 1000 in (1, 3) or bool(code & 0x80000000)) + (code // 1000 in (2, 3) or bool(code & 0x40000000))
    kind, at = _NUMBERS[(code & 0xFFFF) % 1000], at + 5

    def points(start: int, count: int) -> tuple[list, int]:
        values = struct.unpack_from(f"{order}{size * count}d", data, start)
        return [list(values[i : i + size]) for i in range(0, len(values), size)], start + 8 * size * count

    if kind == "Point":
        (one,), at = points(at, 1)
        return kind, one, at
    (count,) = struct.unpack_from(order + "I", data, at)
    at += 4
    if kind == "LineString":
        places, at = points(at, count)
        return kind, places, at
    parts = []
    for _ in range(count):
        if kind == "Polygon":
            (length,) = struct.unpack_from(order + "I", data, at)
            ring, at = points(at + 4, length)
            parts.append(ring)
        else:
            _, inner, at = _of_wkb(data, at)
            parts.append(inner)
    return kind, parts, at
