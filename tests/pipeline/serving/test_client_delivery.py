"""What clients download: maps that WebODM can show, everything once, and what only orthomill makes beside it."""

import json
import zipfile

import laspy
import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from orthomill.pipeline.serving.outputs.asset_files import asset_path
from orthomill.pipeline.serving.outputs.client_maps import plain_system, write_client_map
from orthomill.pipeline.serving.outputs.delivery_archive import write_delivery
from orthomill.pipeline.serving.queue.task_folder import TaskFolder
from orthomill.pipeline.serving.queue.task_state import TaskState
from orthomill.pipeline.serving.queue.wishes import Wishes
from orthomill.schemas.errors import ResourceError, WorkflowError

EAST, NORTH = 500_000.0, 4_320_000.0
"""m, upper left corner of the maps: 21 degrees east, a little above 39 degrees north"""


CODELESS = "+proj=tmerc +lon_0=21.3 +ellps=GRS80 +units=m"


KNOWN = {
    "densification.cells_with_height": 300,
    "densification.cell": 0.5,
    "texture.photo_ground_pixel": 0.023,
    "orientation.gnss_count": 3,
    "orientation.control_count": 2,
    "photos.photographs": 3,
    "run.wall_seconds": None,
}
"""figures of a run"""


def written(path, values: np.ndarray, crs: str, **more):
    profile = {"driver": "GTiff", "height": values.shape[1], "width": values.shape[2], "count": len(values), "dtype": values.dtype}
    path.parent.mkdir(parents=True, exist_ok=True)
    with rasterio.open(path, "w", crs=crs, transform=from_origin(EAST, NORTH, 0.5, 0.5), **profile, **more) as target:
        target.write(values)
    return path


@pytest.fixture
def heights(tmp_path):
    """Heights, standard errors and two more bands in a compound system."""
    values = np.random.default_rng(43).normal(100, 5, (4, 40, 60)).astype(np.float32)
    values[0, :5, :5] = np.nan
    return written(tmp_path / "dsm.tif", values, "EPSG:32634+5773", nodata=np.nan), values


def test_heights_are_those_of_the_product_in_one_band_and_a_plain_system(heights, tmp_path):
    product, values = heights
    assert write_client_map(product, tmp_path / "out/dsm.tif", 1) == ""
    with rasterio.open(tmp_path / "out/dsm.tif") as found:
        assert found.count == 1 and found.crs.to_epsg() == 32634 and found.nodata == -9999
        assert found.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        np.testing.assert_array_equal(found.read(1, masked=True).filled(np.nan), values[0])
    assert not list((tmp_path / "out").glob("*.plain.tif"))


def test_coarser_cells_are_means_and_finer_ones_are_refused_in_a_sentence(heights, tmp_path):
    product, values = heights
    assert write_client_map(product, tmp_path / "coarse.tif", 1, cell=1.0) == ""
    with rasterio.open(tmp_path / "coarse.tif") as found:
        assert found.transform.a == 1.0
        mean = values[0, 20:40, 20:60].reshape(10, 2, 20, 2).mean(axis=(1, 3))
        np.testing.assert_allclose(found.read(1)[10:20, 10:30], mean, atol=1e-3)
    said = write_client_map(product, tmp_path / "fine.tif", 1, cell=0.1)
    assert said == "fine.tif: a cell of 10 cm is finer than what was measured; it has its own of 50 cm."
    with rasterio.open(tmp_path / "fine.tif") as found:
        assert found.transform.a == 0.5


def test_colours_keep_their_mask_and_a_system_without_a_code_is_told(tmp_path):
    values = np.full((4, 40, 60), 200, np.uint8)
    values[3] = np.where(np.arange(60) < 30, 255, 0)
    product = written(
        tmp_path / "ortho.tif", values, "+proj=tmerc +lon_0=21.3 +ellps=GRS80 +units=m", photometric="rgb", alpha="yes"
    )
    assert "without an EPSG code" in write_client_map(product, tmp_path / "map.tif", 4)
    with rasterio.open(tmp_path / "map.tif") as found:
        assert found.count == 4 and found.dataset_mask()[:, 30:].max() == 0 and found.dataset_mask()[:, :30].min() == 255
    assert plain_system("EPSG:2100+5773") == "EPSG:2100" and plain_system("EPSG:32634") == "EPSG:32634"


def run_of(folder: TaskFolder, heights) -> None:
    product, _ = heights
    (folder.run / "products").mkdir(parents=True)
    product.rename(folder.run / "products/dsm.tif")
    for name in ("dsm_check.tif", "accuracy.json", "cameras.json"):
        (folder.run / "products" / name).write_bytes(name.encode())
    cloud = laspy.create(point_format=6)
    cloud.xyz = np.array([[1.0, 2.0, 3.0], [4.0, 6.0, 8.0]])
    cloud.write(folder.run / "products/points.laz")
    for name in ("report.html", "workflow.yaml"):
        (folder.run / name).write_text(name)
    (folder.run / "summary.json").write_text(json.dumps({name: {"value": value} for name, value in KNOWN.items()}))


def shown_by_webodm(figures: dict) -> None:
    """What WebODM 3.2 takes from the figures of a task."""
    cloud = figures["point_cloud_statistics"]
    assert cloud["dense"] and cloud["stats"]["statistic"][0]["count"] == 2
    assert cloud["stats"]["bbox"]["native"]["bbox"] == {
        "minx": 1.0,
        "miny": 2.0,
        "minz": 3.0,
        "maxx": 4.0,
        "maxy": 6.0,
        "maxz": 8.0,
    }
    assert figures["odm_processing_statistics"] == {"average_gsd": pytest.approx(2.3)}
    days = {"start_date": "21/09/2016 at 15:29:25", "end_date": "21/09/2016 at 15:31:25"}
    assert figures["processing_statistics"] == {"area": 75.0, **days}
    block = figures["reconstruction_statistics"]
    assert block["has_gps"] and block["has_gcp"] and "reconstructed_shots_count" not in block
    assert figures["gcp_errors"]["average_error"] == pytest.approx(0.03)
    assert figures["gcp_errors"]["error"]["x"] == pytest.approx((0.001 / 2) ** 0.5)


def test_everything_is_there_once_and_the_output_names_what_only_orthomill_makes(heights, tmp_path):
    folder, asked = TaskFolder(tmp_path / "task"), []
    run_of(folder, heights)

    def command(words: list[str]) -> None:
        asked.append(words[words.index("--as") + 1])
        target = folder.run / words[2]
        if asked[-1] == "odm":
            target.mkdir(parents=True)
            for name in ("cameras.json", "geo.txt"):
                (target / name).write_text(f"odm {name}")
            times = [{"capture_time": 1474471885.0}, {}, {"capture_time": 1474471765.5}]
            errors = [{"role": "control", "error": [0.03, 0.0, 0.04]}, {"role": "control", "error": [-0.01, 0.0, 0.0]}]
            errors.append({"role": "check", "error": [9.0, 9.0, 9.0]})
            for name, known in (("shots", times), ("ground_control_points", errors)):
                (target / f"{name}.geojson").write_text(json.dumps({"features": [{"properties": one} for one in known]}))
        else:
            raise WorkflowError("not today")

    ring = ((21.0, 39.02), (21.0001, 39.02), (21.0001, 39.04), (21.0, 39.04))
    wanted = Wishes(formats=("png",), boundary=ring, dem_cell=0.1)
    lines = write_delivery(folder, TaskState(uuid=folder.uuid, name="n"), wanted, command, "Good.")
    assert asked == ["odm", "ept"]  # no orthoimage, no picture of it
    assert "Not made: entwine_pointcloud: not today" in lines and any("finer than what was measured" in line for line in lines)
    assert "orthomill/dsm_check.tif: where the surface was checked, and by how much it was wrong." in lines
    with zipfile.ZipFile(folder.results) as archive:
        names = archive.namelist()
        assert len(set(names)) == len(names) and archive.testzip() is None
        assert archive.read("cameras.json") == b"odm cameras.json" and archive.read("orthomill/cameras.json") == b"cameras.json"
        cloud = (folder.run / "products/points.laz").read_bytes()
        assert archive.read("odm_georeferencing/odm_georeferenced_model.laz") == cloud
        figures = json.loads(archive.read("odm_report/stats.json"))
        assert {"odm_dem/dsm.tif", "odm_report/shots.geojson", "orthomill/odm/geo.txt", "orthomill/dsm.tif", "log.json"} <= set(
            names
        )
        assert not [name for name in names if "exported" in name]
    shown_by_webodm(figures)
    with rasterio.open(folder.path / "made/odm_dem/dsm.tif") as cut:
        # 0.0001 degrees are 8.7 m at this latitude: what is east of the boundary is not delivered.
        assert cut.width == 18 and cut.count == 1
    for name, content in (("orthomill/workflow.yaml", "workflow.yaml"), ("report.html", "report.html")):
        assert asset_path(folder.path, name).read_text() == content
    assert asset_path(folder.path, "dsm.tif") == folder.path / "made/odm_dem/dsm.tif"
    assert asset_path(folder.path, "all.zip") == folder.results and asset_path(folder.path, "../task.json") is None


def test_only_the_wanted_outputs(heights, tmp_path):
    folder = TaskFolder(tmp_path / "task")
    run_of(folder, heights)
    state = TaskState(uuid=folder.uuid, outputs=("odm_dem", "orthomill/accuracy.json"))
    write_delivery(folder, state, Wishes(tiled_cloud=False), lambda words: None, "")
    with zipfile.ZipFile(folder.results) as archive:
        assert set(archive.namelist()) == {
            "odm_dem/dsm.tif",
            "orthomill/accuracy.json",
            "orthomill/README.txt",
            "task_output.txt",
            "log.json",
        }


def test_the_report_is_printed_where_there_is_a_browser(heights, tmp_path, monkeypatch):
    folder = TaskFolder(tmp_path / "task")
    run_of(folder, heights)
    place = "orthomill.pipeline.serving.outputs.delivery_archive"
    monkeypatch.setattr(f"{place}.can_print", lambda: True)
    monkeypatch.setattr(f"{place}.write_pdf", lambda page: page.with_suffix(".pdf").write_text("paper"))
    write_delivery(folder, TaskState(uuid=folder.uuid), Wishes(tiled_cloud=False), lambda words: None, "", paper=True)
    with zipfile.ZipFile(folder.results) as archive:
        assert archive.read("odm_report/report.pdf") == b"paper"

    def refuses(page):
        raise ResourceError("no ink")

    monkeypatch.setattr(f"{place}.write_pdf", refuses)
    lines = write_delivery(folder, TaskState(uuid=folder.uuid), Wishes(tiled_cloud=False), lambda words: None, "", paper=True)
    assert "Not made: odm_report/report.pdf: no ink" in lines
