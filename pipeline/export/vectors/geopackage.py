"""Features as a GeoPackage: a database that every GIS opens, with points, lines and areas in one file.

Written by Python's own SQLite. Nothing in it depends on the time of writing, so that the same features give the same bytes.

Source: OGC 12-128r18, GeoPackage Encoding Standard 1.3.1.
"""

import sqlite3
import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from pyproj import CRS

from orthomill.pipeline.export.vectors.map_features import Feature, Layer

_TYPES = {"point": (1001, "POINT"), "line": (1002, "LINESTRING"), "area": (1003, "POLYGON")}
"""well-known binary with Z, and the name of the geometry"""
_COLUMN = {bool: "BOOLEAN", int: "INTEGER", float: "DOUBLE", str: "TEXT"}
_OWN_SYSTEM = 100_000
"""number of a system that EPSG does not list"""
_NO_DATE = "2000-01-01T00:00:00.000Z"
"""when the content last changed, which is not told"""
_TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT
  DEFAULT '', last_change DATETIME NOT NULL, min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
  srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL, CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
  CONSTRAINT uk_gc_table_name UNIQUE (table_name), CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES
  gpkg_contents(table_name), CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
INSERT INTO gpkg_spatial_ref_sys VALUES ('Undefined Cartesian', -1, 'NONE', -1, 'undefined', NULL);
INSERT INTO gpkg_spatial_ref_sys VALUES ('Undefined geographic', 0, 'NONE', 0, 'undefined', NULL);
"""


def write_geopackage(path: Path, layers: Iterable[Layer], crs: str | None) -> None:
    """The layers, in the system `crs` (None: no system), as a new file at `path`."""
    with sqlite3.connect(path) as base:
        base.execute(f"PRAGMA application_id = {0x47504B47}")
        base.execute("PRAGMA user_version = 10301")
        base.executescript(_TABLES)
        system = _add_system(base, CRS.from_epsg(4326))
        if crs is not None:
            system = _add_system(base, CRS.from_user_input(crs).to_2d())
        for layer in layers:
            _add_layer(base, layer, system if crs is not None else -1)
    base.close()


def _add_system(base: sqlite3.Connection, system: CRS) -> int:
    plane = system.sub_crs_list[0] if system.is_compound else system
    code = plane.to_epsg()
    number, organization = (code, "EPSG") if code else (_OWN_SYSTEM, "NONE")
    row = (plane.name, number, organization, number, plane.to_wkt("WKT1_GDAL"), None)
    base.execute("INSERT OR IGNORE INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", row)
    return number


def _add_layer(base: sqlite3.Connection, layer: Layer, system: int) -> None:
    code, geometry = _TYPES[layer.kind]
    kinds, extent = _looked_through(layer.features)
    columns = "".join(f', "{name}" {_COLUMN[kind or str]}' for name, kind in kinds.items())
    base.execute(f'CREATE TABLE "{layer.name}" (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom {geometry}{columns})')
    base.execute(
        "INSERT INTO gpkg_contents VALUES (?, 'features', ?, '', ?, ?, ?, ?, ?, ?)",
        (layer.name, layer.name, _NO_DATE, *extent, system),
    )
    base.execute("INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, 1, 0)", (layer.name, geometry, system))
    named = "".join(f', "{name}"' for name in kinds)
    wanted = ", ?" * len(kinds)
    rows = ((_blob(f, code, system), *(f.attributes[name] for name in kinds)) for f in layer.features)
    base.executemany(f'INSERT INTO "{layer.name}" (geom{named}) VALUES (?{wanted})', rows)  # noqa: S608  names of our own layers


def _looked_through(features: Iterable[Feature]) -> tuple[dict[str, type | None], tuple[float | None, ...]]:
    """What the head of a layer says of its features: their attributes, each with the type of its first value (None where there is
    no value), and west, south, east and north of all (None without features)."""
    kinds: dict[str, type | None] = {}
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for feature in features:
        for name, value in feature.attributes.items():
            if kinds.get(name) is None:
                kinds[name] = None if value is None else type(value)
        west, south, east, north = _extent(feature.places)
        low, high = np.minimum(low, (west, south)), np.maximum(high, (east, north))
    return kinds, (*low.tolist(), *high.tolist()) if np.isfinite(low).all() else (None,) * 4


def _extent(places: np.ndarray) -> tuple[float, float, float, float]:
    (west, south), (east, north) = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    return float(west), float(south), float(east), float(north)


def _blob(feature: Feature, code: int, system: int) -> bytes:
    """The geometry with its header and envelope."""
    west, south, east, north = _extent(feature.places)
    envelope = struct.pack("<4d", west, east, south, north)
    # Flags: little endian, an envelope of X and Y.
    return b"GP" + struct.pack("<BBi", 0, 0b00000011, system) + envelope + well_known_binary(feature.places, code, feature.holes)


def well_known_binary(places: np.ndarray, code: int, holes: tuple[np.ndarray, ...] = ()) -> bytes:
    """Little-endian ISO well-known binary of (N, 3) places as the geometry `code`, 1001 to 1003."""
    head = struct.pack("<BI", 1, code)
    if code == _TYPES["point"][0]:
        return head + np.ascontiguousarray(places, "<f8").tobytes()
    rings = [struct.pack("<I", len(ring)) + np.ascontiguousarray(ring, "<f8").tobytes() for ring in (places, *holes)]
    return head + rings[0] if code == _TYPES["line"][0] else head + struct.pack("<I", len(rings)) + b"".join(rings)
