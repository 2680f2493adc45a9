"""`measure`, `covariance` and `accept` on a small run: what they answer, and what they refuse."""

import json
import os
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
from pyproj import Transformer
from rasterio.transform import Affine
from village_pair import block_of, normal_case

from orthomill.finished_project import FinishedProject
from orthomill.pipeline.cli.lookups.covariance_table import covariance_table
from orthomill.pipeline.cli.lookups.delivery import Delivered, acceptance_lines, facts_of_files, facts_of_run, profile_of
from orthomill.pipeline.cli.lookups.kept_acceptance import (
    as_kept,
    by_name,
    digested,
    products_of_run,
    reaccepted,
    recorded,
    written,
)
from orthomill.pipeline.cli.lookups.measured_answers import MeasureOptions, answer_lines, measured_answers
from orthomill.pipeline.report.acceptance_page import acceptance_page
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.accuracy.acceptance import AcceptanceResult
from orthomill.schemas.errors import PhotoError, StoreError, WorkflowError
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.project import Project
from orthomill.schemas.raster import MapGrid, map_raster
from orthomill.schemas.surface import DATUM_PRECISION, HEIGHT, PROVENANCE, RELATIVE_PRECISION, SURFACE, Provenance, Surface
from orthomill.tasks.lookups import StoredCovariance, accepted, inspected, listed_points, measure

GRID = MapGrid(west=400000.0, north=4000100.0, cell=1.0, rows=100, cols=100)


def make_run(folder, height):
    folder.mkdir(parents=True)
    store = Store(folder)
    store.write_table(SURFACE, Surface(grid=GRID, height_low=0.0, height_high=10.0))
    for name, value in ((HEIGHT, height), (RELATIVE_PRECISION, 0.03), (DATUM_PRECISION, 0.1), (PROVENANCE, Provenance.AGREED)):
        dtype = "uint8" if name == PROVENANCE else "float32"
        spec = map_raster(name, GRID, dtype, "EPSG:2100", 100, nodata=None if name == PROVENANCE else float("nan"))
        store.create(spec)
        store.write(name, spec.full, np.full(GRID.shape, value, dtype))
    return folder


@pytest.fixture
def run(tmp_path):
    """A level surface 5 m high."""
    return make_run(tmp_path / "runs" / "site", 5.0)


@pytest.fixture
def square(tmp_path):
    path = tmp_path / "f.geojson"
    ring = [[400020, 4000020], [400060, 4000020], [400060, 4000060], [400020, 4000060], [400020, 4000020]]
    item = {"properties": {"name": "heap"}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    path.write_text(json.dumps({"features": [item], "crs": {"properties": {"name": "EPSG:2100"}}}))
    return path


def options(base="3.5", **given):
    return MeasureOptions(**{"base": base, "checked": False, "corner": 0.1, "step": None, "output": None, **given})


def volume(found):
    return next(a for a in found.answers if a.quantity == "volume")


def test_a_volume_is_measured_and_written(run, square, tmp_path):
    found = measured_answers(run, square, options(output=tmp_path / "a.gpkg"), measure)
    assert volume(found).value == pytest.approx(1600 * 1.5) and volume(found).datum_share == pytest.approx(160)
    assert (tmp_path / "a.gpkg").stat().st_size > 1000
    assert any(line.startswith("heap  volume: 2400") for line in answer_lines(found))


def test_the_base_may_be_an_earlier_run(run, square, tmp_path):
    earlier = make_run(tmp_path / "runs" / "before", 4.0)
    found = volume(measured_answers(run, square, options(str(earlier)), measure))
    assert found.value == pytest.approx(1600) and "the surface of before" in found.note
    assert found.sigma > volume(measured_answers(run, square, options("4"), measure)).sigma


def test_wrong_bases_and_runs_are_refused(run, square, tmp_path):
    with pytest.raises(WorkflowError, match="--base nothing: give border"):
        measured_answers(run, square, options("nothing"), measure)
    with pytest.raises(StoreError, match="has no surface yet"):
        measured_answers(tmp_path, square, options(), measure)
    with pytest.raises(StoreError, match="has no checked surface yet"):
        measured_answers(run, square, options(checked=True), measure)


def test_covariances_need_a_block_and_points(run, tmp_path):
    path = tmp_path / "p.txt"
    path.write_text("name x y z\nP 1 2 3\n")
    with pytest.raises(StoreError, match="has no block yet"):
        covariance_table(run, path, None, StoredCovariance)
    pair = normal_case(420)
    Store(run).write_table(BLOCK, block_of(pair))
    found = covariance_table(run, path, None, StoredCovariance)
    assert found.count == 0 and "fewer than two photographs" in found.missed[0]
    name = block_of(pair).names[0]
    path.write_text(f"photographs/{name.upper()}.JPG\n")
    assert json.loads(covariance_table(run, path, None, StoredCovariance).json)["covariances"][0]["first"] == name
    path.write_text("nobody.jpg\n")
    with pytest.raises(PhotoError, match=r"nobody\.jpg is not in the block"):
        covariance_table(run, path, None, StoredCovariance)
    path.write_text("P 1 2\n")
    with pytest.raises(WorkflowError, match="line 1: 'P 1 2' is neither"):
        covariance_table(run, path, None, StoredCovariance)


def test_a_run_is_held_against_a_profile(run):
    facts = facts_of_run(run, "EPSG:2100")
    result = accepted(profile_of("asprs_2023", None, {"height": 0.1, "estimated": 5.0}), facts, "site")
    lines = list(acceptance_lines(result))
    assert any(line.startswith("met           estimated heights: 0 %") for line in lines) and "not complete" in lines[-1]
    assert "not testable" in acceptance_page(result)


@pytest.fixture
def kept(run):
    """A run with its acceptance, as the command writes it."""
    (run / "products").mkdir()
    (run / "products" / "points.laz").write_bytes(b"heights")
    limits, facts = profile_of("asprs_2023", None, {"height": 0.1, "estimated": 5.0}), facts_of_run(run, "EPSG:2100")
    result = recorded(accepted(limits, facts, "site"), limits, facts, digested([("products", run / "products")]), ())
    written(result, [run / "acceptance.json", run / "acceptance.html"])
    return run


def again(run):
    loaded = SimpleNamespace(run_folder=run, root=run.parent.parent, project=SimpleNamespace(crs="EPSG:2100"))
    return reaccepted(loaded, "site", accepted)


def test_an_acceptance_is_a_document_by_itself(kept):
    assert again(kept) == ()
    text = (kept / "acceptance.html").read_text()
    assert "products/points.laz" in text and "GGRS87 / Greek Grid (EPSG:2100)" in text and "Nothing is proved" in text
    assert (
        "was produced to meet ASPRS" in text
        and "10-cm RMSE<sub>V</sub>" in text
        and "not stated: heights are as the survey" in text
    )
    record = json.loads((kept / "acceptance.json").read_text())["record"]
    assert record["files"][0]["sha256"] in text and record["limits"]["points"] == 30


@pytest.mark.parametrize(
    ("name", "was", "now", "said"),
    [
        ("acceptance.json", "not testable", "met", "acceptance.json does not follow from the products: it has 'accuracy in height"),
        ("acceptance.html", "0.100 m", "0.010 m", "acceptance.html does not follow from acceptance.json"),
        ("products/points.laz", "heights", "hights", "products/points.laz is not the file that acceptance.json names"),
        ("products/points.laz", "heights", None, "products/points.laz is missing, which acceptance.json names"),
        ("acceptance.json", "{", "", "acceptance.json cannot be read"),
    ],
)
def test_what_was_changed_in_an_acceptance_is_named(kept, name, was, now, said):
    path = kept / name
    text = path.read_text()
    path.unlink()
    if now is not None:
        path.write_text(text.replace(was, now, 1))
    assert any(line.startswith(said) and line.endswith("orthomill accept site") for line in again(kept))


def test_a_product_that_cannot_be_read_any_more_ends_no_verification(kept):
    (kept / "products" / "dsm.tif").write_bytes(b"no picture")
    (line,) = again(kept)
    assert line.startswith("acceptance.json cannot be tested again: ") and "is not a GeoTIFF" in line


def test_a_product_with_damage_in_its_middle_is_named(kept):
    given = {"driver": "GTiff", "width": 100, "height": 100, "count": 1, "dtype": "float32", "crs": "EPSG:2100"}
    path = kept / "products" / "dsm.tif"
    with rasterio.open(path, "w", transform=Affine(1, 0, 400000, 0, -1, 4000100), compress="deflate", nodata=-1.0, **given) as file:
        file.write(np.random.default_rng(0).normal(size=(1, 100, 100)).astype(np.float32))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    content[600:900] = b"\xff" * 300
    path.write_bytes(content)
    (line,) = again(kept)
    assert "dsm.tif is damaged: parts of it cannot be read" in line


def test_an_acceptance_that_says_the_same_keeps_its_date(kept):
    known = AcceptanceResult.model_validate_json((kept / "acceptance.json").read_bytes())
    record = known.record.model_copy(update={"tested": "2030-01-01T00:00:00+00:00"})
    assert as_kept(known.model_copy(update={"record": record}), kept) == known
    other = known.model_copy(update={"record": record.model_copy(update={"files": ()})})
    assert as_kept(other, kept) == other
    (kept / "acceptance.json").unlink()
    assert again(kept) == () and as_kept(other, kept) == other


def test_a_digest_is_taken_over_where_the_file_was_not_touched_since(kept):
    other = "0" * 64
    path = kept / "acceptance.json"
    path.write_text(path.read_text().replace(digested([("products", kept / "products")])[0].sha256, other))
    assert [file.sha256 for file in products_of_run(kept)] == [other]
    # Another content of the same size and with the old time.
    product = kept / "products" / "points.laz"
    times = product.stat().st_atime_ns, product.stat().st_mtime_ns
    product.write_bytes(b"hights!")
    os.utime(product, ns=times)
    assert tuple(products_of_run(kept)) == digested([("products", kept / "products")])
    path.unlink()
    assert tuple(products_of_run(kept)) == digested([("products", kept / "products")])


def test_files_are_named_as_they_are_given(tmp_path):
    (tmp_path / "block").mkdir()
    for name in ("a.txt", "b.txt"):
        (tmp_path / "block" / name).write_text(name)
    assert [file.path for file in digested(by_name((tmp_path / "block", None, tmp_path / "block" / "a.txt")))] == [
        "block/a.txt",
        "block/b.txt",
        "a.txt",
    ]


def test_profiles_come_from_files_and_mistakes_are_sentences(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("kind: custom\nplan: 0.1\n")
    assert profile_of(str(path), None).plan == 0.1
    path.write_text("kind: custom\nplam: 0.1\n")
    with pytest.raises(WorkflowError, match="plam"):
        profile_of(str(path), None)
    with pytest.raises(WorkflowError, match="No profile"):
        profile_of(None, None)
    with pytest.raises(WorkflowError, match="give plan, plan_pixels or height"):
        profile_of("asprs_2023", None)
    given = {"project": "site", "crs": "EPSG:25832", "photographs": {"kind": "simulated"}}
    agreed = Project.model_validate({**given, "acceptance": {"kind": "asprs_2023", "plan": 0.07}})
    assert profile_of("asprs_2023", agreed).plan == profile_of(None, agreed).plan == 0.07
    assert profile_of("asprs_2023", agreed, {"plan": 0.1}).plan == 0.1
    with pytest.raises(WorkflowError, match="asks for nothing"):
        profile_of("none", None)


@pytest.fixture
def delivered(tmp_path):
    """A level surface of another program, 5 m high, as a GeoTIFF."""
    path = tmp_path / "theirs.tif"
    given = {"driver": "GTiff", "width": 100, "height": 100, "count": 1, "dtype": "float32", "crs": "EPSG:2100"}
    with rasterio.open(path, "w", transform=Affine(1, 0, 400000, 0, -1, 4000100), **given) as file:
        file.write(np.full((1, 100, 100), 5, np.float32))
    return path


def inspection(dsm, text, crs=None):
    path = dsm.with_name("p.csv")
    path.write_text(text)
    return facts_of_files(Delivered(dsm, None, path), crs, inspected, listed_points)


HEAD = "name,x,y,z,sigma_x,sigma_y,sigma_z\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name,x\nA,1\n", "y"),
        (HEAD, "holds no points"),
        (f"{HEAD}A,400020,4000020,4.9,0.02,0.02,-0.02\n", "must be a positive number"),
        (f"{HEAD}A,400020,4000020,4.9,0.02,0.02,0.02\n" * 2, "name"),
        (f"{HEAD}A,500020,4000020,4.9,0.02,0.02,0.02\n", "None of the 1 points of .*p.csv lies on .*theirs.tif"),
        (f"{HEAD}A,1312401.6,13123425.2,4.9,0.02,0.02,0.02\n", "only if their coordinates are feet"),
        (f"{HEAD}A,9000020,9000020,4.9,0.02,0.02,0.02\n", "None of the 1 points"),
    ],
)
def test_points_of_an_inspector_that_cannot_be_used(delivered, text, words):
    with pytest.raises(WorkflowError, match=words):
        inspection(delivered, text)


def test_an_inspector_reads_what_surveyors_write(delivered):
    facts = inspection(delivered, "Punkt;Rechtswert;Hochwert;Höhe\nA;400020,5;4000020,5;4,9\nB;400060,5;4000060,5;4,8\n")
    assert facts.statement.of("nva").points == 2 and facts.statement.of("nva").survey == pytest.approx(0.05)
    assert "lack standard errors" in facts.remarks[-1]
    degrees = Transformer.from_crs("EPSG:2100", "EPSG:4326", always_xy=True).transform(400020.5, 4000020.5)
    moved = inspection(delivered, f"{HEAD}A,{degrees[0]:.10f},{degrees[1]:.10f},4.9,0.02,0.02,0.02\n", "EPSG:4326")
    assert moved.statement.of("nva").fit == pytest.approx(0.1, abs=1e-4)


def test_a_point_without_a_height_tests_none(delivered):
    facts = inspection(delivered, f"{HEAD}A,400020,4000020,4.9,0.02,0.02,0.02\nB,400060,4000060,nan,0.02,0.02,0.02\n")
    assert facts.statement.of("nva").points == 1
    assert dict(facts.statement.untested)["B"] == "height: the point was surveyed without a height"


def test_files_that_are_not_there_or_something_else_are_named(delivered, tmp_path):
    with pytest.raises(WorkflowError, match=r"There is no file .*nothing\.tif \(--dsm\)"):
        facts_of_files(Delivered(tmp_path / "nothing.tif", None, None), None, inspected, listed_points)
    colours = tmp_path / "colours.tif"
    given = {"driver": "GTiff", "width": 100, "height": 100, "count": 3, "dtype": "uint8", "crs": "EPSG:32634"}
    with rasterio.open(colours, "w", transform=Affine(1, 0, 400000, 0, -1, 4000100), **given) as file:
        file.write(np.full((3, 100, 100), 5, np.uint8))
    with pytest.raises(WorkflowError, match="bands of colours and no heights"):
        facts_of_files(Delivered(colours, None, None), None, inspected, listed_points)
    with pytest.raises(WorkflowError, match=r"is in EPSG:2100 and .* in EPSG:32634"):
        facts_of_files(Delivered(delivered, colours, None), None, inspected, listed_points)


def test_gaps_of_a_surface_and_the_area_that_it_covers(delivered, tmp_path):
    with rasterio.open(delivered, "r+") as file:
        file.nodata = -1.0
        file.write(np.full((20, 50), -1, np.float32), 1, window=((40, 60), (10, 60)))
    area = tmp_path / "area.geojson"
    ring = [[399980, 4000000], [400080, 4000000], [400080, 4000100], [399980, 4000100], [399980, 4000000]]
    named = {"properties": {"name": "EPSG:2100"}}
    area.write_text(
        json.dumps({"features": [{"properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}], "crs": named})
    )
    facts = facts_of_files(Delivered(delivered, None, None), None, inspected, listed_points, area)
    assert facts.gaps == pytest.approx(10) and facts.covered == (("surface", pytest.approx(70)),)


def test_a_surface_of_another_program_names_its_heights(delivered, tmp_path):
    named = tmp_path / "named.tif"
    given = {"driver": "GTiff", "width": 9, "height": 9, "count": 1, "dtype": "float32", "crs": "EPSG:7415"}
    with rasterio.open(named, "w", transform=Affine(1, 0, 100000, 0, -1, 400000), **given) as file:
        file.write(np.full((1, 9, 9), 5, np.float32))
    outcomes = []
    for path in (delivered, named):
        facts = facts_of_files(Delivered(path, None, None), None, inspected, listed_points)
        (clause,) = accepted(profile_of("custom", None, {"heights_named": True}), facts, "it").clauses
        outcomes.append((clause.found, clause.outcome))
    assert outcomes == [("none beside EPSG:2100", "missed"), ("NAP height (EPSG:5709)", "met")]


def test_a_clause_that_cannot_be_tested_says_why(delivered):
    facts = inspection(delivered, f"{HEAD}A,400020,4000020,nan,0.02,0.02,0.02\nB,400060,4000060,nan,0.02,0.02,0.02\n")
    result = accepted(profile_of("custom", None, {"height": 0.1}), facts, "it")
    assert "(2 of 2: the point was surveyed without a height)" in result.clauses[0].found


def test_a_notebook_measures_as_the_command_does(run, square):
    found = FinishedProject(run).measure(square, base="3.5", corner=0.1)
    assert volume(found) == volume(measured_answers(run, square, options(), measure))
