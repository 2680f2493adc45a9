"""Points of a photograph on the surface of a run: the file of points, the table, and what cannot be answered."""

import csv
import io

import numpy as np
import pytest
from small_site import command, make_site
from village_pair import block_of, normal_case

from orthomill.pipeline.cli.lookups.monoplot import monoplot_table, read_image_points
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError, WorkflowError
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import MapGrid, map_raster
from orthomill.schemas.surface import HEIGHT, PRECISION, SURFACE, Surface
from orthomill.tasks.lookups import points_on_surface


@pytest.fixture
def run(tmp_path):
    """A run with a level surface 5 m high."""
    folder = tmp_path / "runs" / "site"
    folder.mkdir(parents=True)
    store, pair = Store(folder), normal_case(420)
    grid = MapGrid(west=0.0, north=0.0, cell=2.0, rows=100, cols=100)
    store.write_table(BLOCK, block_of(pair))
    store.write_table(SURFACE, Surface(grid=grid, height_low=0.0, height_high=10.0))
    for name, value in ((HEIGHT, 5.0), (PRECISION, 0.2)):
        spec = map_raster(name, grid, "float32", "EPSG:2100", 100, nodata=float("nan"))
        store.create(spec)
        store.write(name, spec.full, np.full(grid.shape, value, np.float32))
    return folder


def points(tmp_path, text: str):
    path = tmp_path / "points.txt"
    path.write_text(text, encoding="utf-8")
    return read_image_points(path)


def test_names_separators_headings_and_comments_are_understood(tmp_path):
    read = points(tmp_path, "name,col,row\n# a comment\nP1, 10.5, 20\n\nP2;11;21\n12 22\n")
    assert read.names == ("P1", "P2", "3")
    assert np.array_equal(read.pixels, [[10.5, 20], [11, 21], [12, 22]])


@pytest.mark.parametrize("line", ["P1 10", "P1 ten 20", "1 2 3 4", "P1 nan 3"])
def test_a_line_that_is_no_point_is_named(tmp_path, line):
    with pytest.raises(WorkflowError, match=r"line 2: .* is no point; write col and row"):
        points(tmp_path, f"5 6\n{line}\n")


def test_files_without_points_are_refused(tmp_path):
    with pytest.raises(WorkflowError, match="holds no point"):
        points(tmp_path, "col row\n")
    with pytest.raises(WorkflowError, match="cannot be read"):
        read_image_points(tmp_path / "absent.txt")


def test_the_table_has_places_precision_photographs_and_a_sentence_for_what_hits_nothing(run, tmp_path):
    table = monoplot_table(run, "a", points(tmp_path, "P1 160 150\nfar 9999 150\n"), 0.5, points_on_surface)
    first, far = csv.DictReader(io.StringIO(table.csv))
    assert float(first["z"]) == pytest.approx(5.0, abs=2e-3) and float(first["sigma_z"]) == pytest.approx(0.2, rel=0.01)
    assert first["photographs"] == "b" and float(first["sigma_x"]) > 0
    assert far["x"] == "" and table.count == 2
    assert table.missed == (
        "far (9999, 150) hits nothing: it lies outside the photograph a, or its ray meets no height of the surface; measure it in "
        "another photograph.",
    )


def test_a_run_without_a_surface_is_told_what_to_run(tmp_path, monkeypatch):
    root = make_site(tmp_path / "root")
    (root / "points.txt").write_text("10 20\n")
    monkeypatch.chdir(root)
    said = command("monoplot", "site", "photo", "--points", "points.txt", code=2)
    assert "has no surface yet" in said and "--until densification" in said


def test_a_run_needs_all_of_its_surface(tmp_path):
    with pytest.raises(StoreError, match="has no surface yet"):
        monoplot_table(tmp_path, "a", points(tmp_path, "1 2\n"), 0.5, points_on_surface)
