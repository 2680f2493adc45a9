"""Geometries as they are in a file: name, kind, coordinates, reference system; GeoPackage and GeoJSON.

Source: OGC 12-128r19, GeoPackage Encoding Standard 1.4, clause 2.1.3 (geometry BLOBs); OGC 06-103r4 for well-known binary; RFC
7946.
"""

import json
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pyproj.exceptions import CRSError

from orthomill.schemas.errors import WorkflowError

_ENVELOPES = (0, 32, 48, 48, 64)
"""bytes of an envelope, by its kind"""
_NAMES = ("name", "label", "feature", "id", "fid")


@dataclass(frozen=True)
class Geometry:
    """A geometry: kind and coordinates as GeoJSON has them; system: of its coordinates, None where the file names none."""

    name: str
    kind: str
    coordinates: Any
    system: str | None


Reader = Callable[[Path], Iterator[Geometry]]


def read_geometries(path: Path, more: dict[str, Reader], words: str) -> tuple[Geometry, ...]:
    """All geometries of a file; `more`: readers by suffix besides those for GeoPackage and GeoJSON, `words`: suffixes that can be
    given. Raises WorkflowError for what cannot be read."""
    readers = {".gpkg": _of_geopackage, ".geojson": _of_geojson, ".json": _of_geojson, **more}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise WorkflowError(f"{path} is no file of features that can be read; give {words}.")
    if not path.is_file():
        raise WorkflowError(f"There is no file {path}.")
    return understood(path, lambda: tuple(reader(path)))


def understood(path: Path, read: Callable[[], tuple]) -> tuple:
    """What `read` makes of a file. Raises WorkflowError where it is not what its name says."""
    try:
        return read()
    except CRSError as error:
        raise WorkflowError(f"{path}: its reference system is not known ({error}).") from error
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, IndexError, struct.error, sqlite3.Error) as error:
        raise WorkflowError(f"{path} cannot be read ({error}); export the features as GeoPackage or GeoJSON again.") from error


def _of_geojson(path: Path) -> Iterator[Geometry]:
    whole = json.loads(path.read_text(encoding="utf-8-sig"))
    named = ((whole.get("crs") or {}).get("properties") or {}).get("name")
    # RFC 7946 knows longitude and latitude only; what QGIS and GDAL write beside it names its system.
    system = named or "EPSG:4326"
    for number, item in enumerate(whole.get("features", [whole]), 1):
        geometry, known = item.get("geometry", item), item.get("properties") or {}
        name = next((str(known[key]) for key in _NAMES if known.get(key) is not None), str(number))
        yield Geometry(name, geometry["type"], geometry["coordinates"], system)


def _of_geopackage(path: Path) -> Iterator[Geometry]:
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
                if (blob := values[column]) and blob[:2] == b"GP":
                    kind, places, _ = _of_wkb(blob, 8 + _ENVELOPES[(blob[3] >> 1) & 7])
                    yield Geometry(name, kind, places, system)


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
