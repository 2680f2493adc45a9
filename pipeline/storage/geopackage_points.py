"""Points of a GeoPackage as CSV text: name, x, y, z, standard errors where it has them, and the reference system, to be read like
any other list of points.

Source: OGC 12-128r19, GeoPackage Encoding Standard 1.4, clause 2.1.3 (geometry BLOBs); OGC 06-103r4 for well-known binary.
"""

import csv
import io
import sqlite3
import struct
from contextlib import closing
from pathlib import Path
from typing import Any

from orthomill.schemas.errors import WorkflowError

SUFFIX = ".gpkg"
_NAMES = ("name", "label", "id", "point", "nr", "bezeichnung", "nom", "nombre")
"""columns that hold names of points, by preference"""
_SIGMAS = ("sigma_x", "sigma_y", "sigma_z")
_ENVELOPES = (0, 32, 48, 48, 64)
"""bytes of an envelope, by its kind"""


def points_csv(path: Path) -> tuple[str, str | None]:
    """The points of the first layer of points: CSV text with name,x,y,z, its columns sigma_x, sigma_y, sigma_z, and the system
    ("EPSG:32632"; None where it is not by EPSG). Raises WorkflowError for a file that cannot be read, or holds no points."""
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
            return _first_layer(database, path)
    except (sqlite3.Error, struct.error, IndexError) as error:
        raise WorkflowError(f"{path} cannot be read as a GeoPackage ({error}); export the points as CSV instead.") from error


def _first_layer(database: sqlite3.Connection, path: Path) -> tuple[str, str | None]:
    layers = database.execute(
        "SELECT g.table_name, g.column_name, s.organization, s.organization_coordsys_id FROM gpkg_geometry_columns g "
        "LEFT JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id"
    ).fetchall()
    for table, column, authority, code in layers:
        # A name of a table cannot be a parameter; quoted, it can be nothing else than a name.
        found = database.execute(f"SELECT * FROM {_quoted(table)}")  # noqa: S608
        heads = [head[0] for head in found.description]
        rows = [dict(zip(heads, row, strict=True)) for row in found]
        points = [(row, place) for row in rows if (place := _point(row[column])) is not None]
        if points:
            named = _name_column(heads, column)
            system = f"EPSG:{code}" if str(authority).upper() == "EPSG" else None
            sigmas = [head for head in heads if head.casefold() in _SIGMAS]
            lines = [
                (_name(row, named, n), *map(repr, place), *(row[s] for s in sigmas)) for n, (row, place) in enumerate(points, 1)
            ]
            return _text(("name", "x", "y", "z", *map(str.casefold, sigmas)), lines), system
    raise WorkflowError(f"{path} holds no layer of points; its layers are {', '.join(layer[0] for layer in layers) or 'none'}.")


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _name_column(heads: list[str], geometry: str) -> str | None:
    folded = {head.casefold(): head for head in heads if head != geometry}
    return next((folded[name] for name in _NAMES if name in folded), None)


def _name(row: dict[str, Any], column: str | None, number: int) -> str:
    value = row.get(column) if column else None
    return str(value) if value not in (None, "") else str(number)


def _point(blob: bytes | None) -> tuple[float, float, float] | None:
    """Coordinates of a point, its height NaN where it has none; None for any other geometry."""
    if not blob or blob[:2] != b"GP" or blob[3] & 0b10000:  # without a header, or empty
        return None
    body = blob[8 + _ENVELOPES[(blob[3] >> 1) & 0b111] :]
    order = "<" if body[0] == 1 else ">"
    kind = struct.unpack(order + "I", body[1:5])[0]
    # 1001 and 3001 by the standard, the high bit by earlier writers: a point with a height.
    flat, high = kind & 0xFFFF, bool(kind & 0x80000000) or kind % 10000 // 1000 in (1, 3)
    if flat % 1000 != 1:
        return None
    x, y = struct.unpack(order + "2d", body[5:21])
    return x, y, struct.unpack(order + "d", body[21:29])[0] if high else float("nan")


def _text(heads: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    return out.getvalue()
