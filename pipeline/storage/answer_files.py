"""Answers about features as CSV, JSON or GeoPackage.

Source: OGC 12-128r19, GeoPackage Encoding Standard 1.4: the tables that a file must have, and geometry BLOBs.
"""

import csv
import io
import json
import math
import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from pyproj import CRS

from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.accuracy.surface_answers import DrawnFeature, MeasuredAnswers, ProfilePoint, SurfaceAnswer
from orthomill.schemas.errors import StoreError

_TABLES = """
PRAGMA application_id = 1196444487;
PRAGMA user_version = 10400;
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
 organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
 description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT '1970-01-01T00:00:00.000Z',
 min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE,
 srs_id INTEGER);
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
 srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL, PRIMARY KEY (table_name, column_name));
INSERT INTO gpkg_spatial_ref_sys VALUES ('undefined cartesian', -1, 'NONE', -1, 'undefined', ''),
 ('undefined geographic', 0, 'NONE', 0, 'undefined', ''),
 ('WGS 84', 4326, 'EPSG', 4326, 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
  || 'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]', '');
"""


def write_answers(path: Path, answers: MeasuredAnswers, features: Sequence[DrawnFeature], crs: str) -> None:
    """Write the answers, as the end of the name says. Raises StoreError for another end."""
    suffix = path.suffix.lower()
    if suffix == ".csv":
        write_whole(path, answers_csv(answers).encode())
    elif suffix == ".json":
        text = {"correlation": answers.correlation, "answers": _rows(answers.answers), "profiles": _rows(answers.profiles)}
        write_whole(path, json.dumps(text, indent=1).encode())
    elif suffix == ".gpkg":
        _write_geopackage(path, answers, features, crs)
    else:
        raise StoreError(f"{path}: answers are written as .csv, .json or .gpkg.")


def answers_csv(answers: MeasuredAnswers) -> str:
    """The answers as a table; profiles are in JSON and GeoPackage only."""
    out = io.StringIO()
    writer = csv.DictWriter(out, [field.name for field in fields(SurfaceAnswer)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(_rows(answers.answers))
    return out.getvalue()


def _rows(items: Sequence[SurfaceAnswer | ProfilePoint]) -> list[dict[str, Any]]:
    """As plain values; what is not known is empty, for JSON has no NaN."""
    return [{key: None if _is_nan(value) else value for key, value in asdict(item).items()} for item in items]


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _write_geopackage(path: Path, answers: MeasuredAnswers, features: Sequence[DrawnFeature], crs: str) -> None:
    path.unlink(missing_ok=True)
    try:
        with closing(sqlite3.connect(path)) as database:
            database.executescript(_TABLES)
            system = _system(database, crs)
            shapes = {feature.name: _blob(feature, system) for feature in features}
            _layer(
                database,
                "answers",
                [(shapes[a.feature], row) for a, row in zip(answers.answers, _rows(answers.answers), strict=True)],
                system,
            )
            points = [
                (_point_blob(p.x, p.y, system), row) for p, row in zip(answers.profiles, _rows(answers.profiles), strict=True)
            ]
            if points:
                _layer(database, "profiles", points, system)
            database.commit()
    except sqlite3.Error as error:
        raise StoreError(f"{path} cannot be written ({error}).") from error


def _system(database: sqlite3.Connection, crs: str) -> int:
    """Enters the reference system; returns its number in the file."""
    found = CRS.from_user_input(crs)
    plan = found.sub_crs_list[0] if found.is_compound else found
    code = plan.to_epsg(min_confidence=70)
    if code == 4326:
        return code
    number, authority = (code, "EPSG") if code else (100_000, "NONE")
    row = (plan.name, number, authority, number, plan.to_wkt("WKT1_GDAL"), "")
    database.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", row)
    return number


def _layer(database: sqlite3.Connection, name: str, rows: list[tuple[bytes, dict[str, Any]]], system: int) -> None:
    if not rows:
        return
    kinds = {str: "TEXT", bool: "BOOLEAN", float: "DOUBLE"}
    texts = {key for _, row in rows for key, value in row.items() if isinstance(value, str)}
    columns = {key: "TEXT" if key in texts else kinds.get(type(value), "DOUBLE") for key, value in rows[0][1].items()}
    names = ", ".join(f'"{key}" {kind}' for key, kind in columns.items())
    database.execute(f'CREATE TABLE "{name}" (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom BLOB, {names})')
    marks = ", ".join("?" * (len(columns) + 1))
    keys = ", ".join(f'"{key}"' for key in columns)
    database.executemany(
        f'INSERT INTO "{name}" (geom, {keys}) VALUES ({marks})',  # noqa: S608
        [(blob, *(row[key] for key in columns)) for blob, row in rows],
    )
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES (?, 'features', ?, ?)", (name, name, system)
    )
    database.execute("INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'GEOMETRY', ?, 0, 0)", (name, system))


def _blob(feature: DrawnFeature, system: int) -> bytes:
    """A feature as a geometry BLOB without envelope."""
    places = feature.places.tolist()
    if feature.kind == "point":
        return _point_blob(places[0][0], places[0][1], system)
    if feature.kind == "line":
        return _head(system) + struct.pack("<BI", 1, 2) + _places(places)
    rings = [_places([*ring, ring[0]]) for ring in (places, *(hole.tolist() for hole in feature.holes))]
    return _head(system) + struct.pack("<BII", 1, 3, len(rings)) + b"".join(rings)


def _places(places: list[list[float]]) -> bytes:
    """A list of X, Y with its length before it."""
    return struct.pack(f"<I{2 * len(places)}d", len(places), *(value for place in places for value in place))


def _point_blob(x: float, y: float, system: int) -> bytes:
    return _head(system) + struct.pack("<BI2d", 1, 1, x, y)


def _head(system: int) -> bytes:
    return b"GP" + struct.pack("<BBi", 0, 1, system)
