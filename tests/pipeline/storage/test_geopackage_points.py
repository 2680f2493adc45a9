"""Points of a GeoPackage, as QGIS and others write them."""

import sqlite3
import struct

import pytest

from orthomill.pipeline.storage.geopackage_points import points_csv
from orthomill.schemas.errors import WorkflowError


def geopackage(path, rows, blob, code=32632):
    """A layer `points` with rows (name, geometry)."""
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE gpkg_spatial_ref_sys (srs_id INTEGER, organization TEXT, organization_coordsys_id INTEGER)")
        database.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (1, 'EPSG', ?)", (code,))
        database.execute("CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, srs_id INTEGER)")
        database.execute("INSERT INTO gpkg_geometry_columns VALUES ('my points', 'geom', 1)")
        database.execute('CREATE TABLE "my points" (fid INTEGER, geom BLOB, Name TEXT)')
        database.executemany(
            'INSERT INTO "my points" VALUES (?, ?, ?)', [(n, blob(*place), name) for n, (name, place) in enumerate(rows)]
        )


def header(envelope=0):
    return b"GP\x00" + bytes([1 | envelope << 1]) + struct.pack("<i", 1) + bytes((0, 32, 48)[envelope])


def high(x, y, z):
    return header(2) + b"\x01" + struct.pack("<I3d", 1001, x, y, z)


def flat(x, y):
    return header() + b"\x00" + struct.pack(">I2d", 1, x, y)


def old(x, y, z):
    return header() + b"\x01" + struct.pack("<I3d", 0x80000001, x, y, z)


@pytest.mark.parametrize("blob", [high, old])
def test_names_coordinates_and_system(tmp_path, blob):
    geopackage(tmp_path / "p.gpkg", [("A", (1.5, 2.25, 3.125)), (None, (4.0, 5.0, 6.0))], blob)
    text, system = points_csv(tmp_path / "p.gpkg")
    assert text.splitlines() == ["name,x,y,z", "A,1.5,2.25,3.125", "2,4.0,5.0,6.0"] and system == "EPSG:32632"


def test_standard_errors_come_along(tmp_path):
    geopackage(tmp_path / "p.gpkg", [("A", (1.0, 2.0, 3.0))], high)
    with sqlite3.connect(tmp_path / "p.gpkg") as database:
        database.execute('ALTER TABLE "my points" ADD COLUMN Sigma_Z REAL DEFAULT 0.02')
    assert points_csv(tmp_path / "p.gpkg")[0].splitlines() == ["name,x,y,z,sigma_z", "A,1.0,2.0,3.0,0.02"]


def test_points_without_heights(tmp_path):
    geopackage(tmp_path / "p.gpkg", [("A", (1.0, 2.0))], flat)
    assert points_csv(tmp_path / "p.gpkg")[0].splitlines()[1] == "A,1.0,2.0,nan"


def test_what_is_no_geopackage_is_told(tmp_path):
    (tmp_path / "p.gpkg").write_text("name,x,y,z\n")
    with pytest.raises(WorkflowError, match="export the points as CSV"):
        points_csv(tmp_path / "p.gpkg")
    geopackage(tmp_path / "lines.gpkg", [("A", (1.0, 2.0))], lambda x, y: header() + b"\x01" + struct.pack("<I", 2))
    with pytest.raises(WorkflowError, match="holds no layer of points; its layers are my points"):
        points_csv(tmp_path / "lines.gpkg")
