"""Records of a run: every file with its digest, what is tested apart from what is promised, nothing that refers to nowhere."""

import hashlib
import json
from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from orthomill.pipeline.cli.export_kinds import Asked, export_as
from orthomill.pipeline.engine.run_facts import RunFacts, StageRun, write_facts
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.metadata.xml_writing import SPACES
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.accuracy.accuracy_statement import STATEMENT, AccuracyFigure, AccuracyStatement
from orthomill.schemas.errors import StoreError
from orthomill.schemas.photo import PHOTOS, Photo, Photos
from orthomill.schemas.stage_report import Figure, Product, StageReport, report_table

FIGURE = AccuracyFigure(
    kind="nva",
    points=4,
    needed=30,
    fit=0.02,
    survey=0.02,
    rmse=0.0283,
    low=0.021,
    high=None,
    mean=0.01,
    robust=0.01,
    at_90=0.03,
    at_95=0.03,
    promised=0.9,
    class_cm=3,
    proved_cm=None,
    sentence="This data set was tested with ONLY 4 checkpoints.",
)


def run_of(folder, times=("2026:05:01 10:00:00", "2026:05:01 10:20:00"), statement=True):
    """A finished run with an orthoimage, a surface and a table."""
    store = Store(folder)
    size = {"width": 10, "height": 10, "bands": 3, "dtype": "uint8", "camera": "c"}
    photos = tuple(Photo(name=f"p{k}", path=f"in/p{k}.jpg", time=time, **size) for k, time in enumerate(times))
    store.write_table(PHOTOS, Photos(photos=photos))
    products = (Product(path="products/dsm.tif", purpose="Surface model"),)
    figures = (Figure(name="precision_median", value=0.04), Figure(name="method", value="volume"))
    store.write_table(report_table("densification"), StageReport(products=products, figures=figures))
    if statement:
        store.write_table(STATEMENT, AccuracyStatement(figures=(FIGURE,), level="tested"))
    (folder / "products").mkdir(exist_ok=True)
    place = {"driver": "GTiff", "width": 40, "height": 30, "crs": "EPSG:2100", "transform": from_origin(407000, 4357600, 2, 2)}
    for name, dtype, nodata in (("ortho", "uint8", None), ("dsm", "float32", np.nan)):
        with rasterio.open(folder / f"products/{name}.tif", "w", count=1, dtype=dtype, nodata=nodata, **place) as target:
            target.write(np.ones((1, 30, 40), dtype))
            target.set_band_description(1, f"{name} (m)")
    (folder / "products/points.csv").write_text("x\n1\n")
    stages = (StageRun("densification", jobs=3, done=3, seconds=1.5), StageRun("texture", jobs=1, done=1))
    begun, ended = "2026-11-27T07:03:07+0000", "2026-11-27T07:12:41+0000"
    write_facts(folder, RunFacts("site", "EPSG:2100", "0.2.0", begun, ended, stages=stages, workflow="project: site\n"))
    return folder


def made(folder, kind, path=None):
    return export_as(Asked(kind, None, Wanted(), path), folder)


def test_assets_of_the_stac_item_are_the_files_with_their_digests(tmp_path):
    path = made(run_of(tmp_path), "stac")
    item = json.loads(path.read_text())
    assert {"type", "stac_version", "id", "geometry", "bbox", "properties", "links", "assets"} <= set(item)
    assert set(item["assets"]) == {"ortho.tif", "dsm.tif", "points.csv"}
    for asset in item["assets"].values():
        file = (path.parent / asset["href"]).resolve()
        assert asset["file:checksum"] == "1220" + hashlib.sha256(file.read_bytes()).hexdigest()
        assert asset["file:size"] == file.stat().st_size
    dsm = item["assets"]["dsm.tif"]
    with rasterio.open(tmp_path / "products/dsm.tif") as found:
        assert dsm["proj:code"] == "EPSG:2100" and dsm["proj:shape"] == list(found.shape)
        assert dsm["proj:transform"] == list(found.transform)[:6] and dsm["proj:bbox"] == list(found.bounds)
    assert dsm["bands"] == [{"data_type": "float32", "name": "dsm (m)", "nodata": "nan"}] and dsm["description"] == "Surface model"
    west, south, east, north = item["bbox"]
    ring = np.array(item["geometry"]["coordinates"][0])
    assert ring[0].tolist() == ring[-1].tolist() and len(ring) == 5 and west < ring[0][0] + 1e-5 < east and south < north
    times = item["properties"]
    assert times["datetime"] is None and times["start_datetime"] == "2026-05-01T10:00:00Z" < times["end_datetime"]


def test_an_item_may_lie_anywhere_in_the_runs_folder(tmp_path):
    path = made(run_of(tmp_path), "stac", "catalogue/site/item.json")
    assert all((path.parent / one["href"]).is_file() for one in json.loads(path.read_text())["assets"].values())


def test_photographs_without_a_time_do_not_invent_one(tmp_path):
    times = json.loads(made(run_of(tmp_path, times=(None, None)), "stac").read_text())["properties"]
    assert times["datetime"] == "2026-11-27T07:12:41Z" and "no time" in times["orthomill:datetime"]


def reports(root) -> list[tuple[str, str, float, str]]:
    """(kind of the element, way of evaluation, value, words) of every report of quality."""
    rows = []
    for one in root.iterfind(".//mdq:report/*", SPACES):
        way = one.find(".//mdq:DQ_EvaluationMethodTypeCode", SPACES).get("codeListValue")
        text = one.find(".//mdq:evaluationMethodDescription/gco:CharacterString", SPACES).text
        rows.append((one.tag.partition("}")[2], way, float(one.find(".//gco:Record", SPACES).text), text))
    return rows


@pytest.mark.parametrize("kind", ["iso19157", "iso19115"])
def test_what_is_tested_and_what_is_promised_stand_apart(tmp_path, kind):
    root = ElementTree.parse(made(run_of(tmp_path), kind)).getroot()
    tested, promised = reports(root)
    assert tested[:3] == ("DQ_AbsoluteExternalPositionalAccuracy", "directExternal", 0.0283)
    assert (
        "4 independent points (a formal statement needs 30)" in tested[3]
        and "no upper end" in tested[3]
        and FIGURE.sentence in tested[3]
    )
    assert promised[:3] == ("DQ_RelativeInternalPositionalAccuracy", "directInternal", 0.04) and promised[3].startswith(
        "PROMISED, not tested"
    )
    ids = [one.get(f"{{{SPACES['gml']}}}id") for one in root.iter() if one.get(f"{{{SPACES['gml']}}}id")]
    assert len(set(ids)) == len(ids)


def test_without_a_test_nothing_is_called_tested(tmp_path):
    root = ElementTree.parse(made(run_of(tmp_path, statement=False), "iso19157")).getroot()
    assert [row[1] for row in reports(root)] == ["directInternal"]


def test_the_record_of_iso_19115_tells_where_when_and_from_what(tmp_path):
    root = ElementTree.parse(made(run_of(tmp_path), "iso19115")).getroot()

    def text(path):
        return root.find(path, SPACES).text

    assert text(".//mrs:referenceSystemIdentifier//gco:CharacterString") == "EPSG:2100"
    assert 22.5 < float(text(".//gex:westBoundLongitude/gco:Decimal")) < float(text(".//gex:eastBoundLongitude/gco:Decimal")) < 23.5
    assert text(".//gml:beginPosition") == "2026-05-01T10:00:00Z" and text(".//gco:Distance") == "2"
    assert "densification, texture" in text(".//mrl:statement/gco:CharacterString")
    linked = [one.text for one in root.iterfind(".//cit:linkage/gco:CharacterString", SPACES)]
    assert linked == ["../dsm.tif", "../ortho.tif", "../points.csv"]
    order = [child.tag.partition("}")[2] for child in root]
    assert order.index("contact") < order.index("dateInfo") < order.index("identificationInfo") < order.index("resourceLineage")


def test_provenance_refers_to_nothing_that_is_not_there(tmp_path):
    record = json.loads(made(run_of(tmp_path), "prov").read_text())
    known = {name for kind in ("entity", "activity", "agent") for name in record[kind]}
    for relation in ("used", "wasGeneratedBy", "wasInformedBy", "wasAssociatedWith"):
        for one in record[relation].values():
            assert set(one.values()) <= known, one
    by = {one["prov:entity"]: one["prov:activity"] for one in record["wasGeneratedBy"].values()}
    assert by["orthomill:product/dsm.tif"] == "orthomill:stage/site/densification"
    assert by["orthomill:product/points.csv"] == "orthomill:run/site"
    assert record["entity"]["orthomill:workflow/site"]["orthomill:sha256"] == hashlib.sha256(b"project: site\n").hexdigest()


def test_a_run_that_is_not_finished_has_no_records(tmp_path):
    with pytest.raises(StoreError, match="is not finished"):
        made(tmp_path, "stac")
    run_of(tmp_path)
    for one in (tmp_path / "products").glob("*.tif"):
        one.unlink()
    with pytest.raises(StoreError, match="nothing for a catalogue"):
        made(tmp_path, "prov")
