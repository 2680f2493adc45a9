"""The shipped project `volos_small` from the first command to the last product, against the truth that only it can know.

The bounds follow from the geometry: a pixel is 0.65 m on the ground, base over height is 0.56, so a pixel of parallax is 1.17 m of
height; heights better than a third of that, plan better than half a pixel, and nothing worse than three of its own standard errors.
"""

import json
import re
import shutil
from html.parser import HTMLParser

import laspy
import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp
from simulated_run import PROJECT, Run
from small_site import command, command_in, results_of

from orthomill.pipeline.records.records import Records
from orthomill.pipeline.storage.features.outline_files import read_outlines
from orthomill.schemas.bare_ground import CellClass
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.orientation import Block
from orthomill.schemas.surface import MEASURED

pytestmark = pytest.mark.slow

STAGES = (
    "simulation",
    "photos",
    "calibration",
    "tie_points",
    "orientation",
    "epipolar",
    "densification",
    "dsm_check",
    "terrain",
    "texture",
    "viewer",
    "accuracy",
    "evaluation",
)
CRS = "EPSG:2100"
PARALLAX_HEIGHT = 1.17
"""m of height that a pixel of parallax is worth"""


@pytest.fixture(scope="session")
def figures(run):
    return run.summary()


@pytest.fixture
def copy(run, tmp_path, monkeypatch):
    """A copy of the root that a test may run again; the current folder."""
    shutil.copytree(run.root, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")
    return Run(tmp_path / "copy", "")


# --- the run -----------------------------------------------------------------------------------------------------------------


def test_every_stage_is_complete_and_nothing_failed(run, figures):
    assert figures["run.complete"] is True and figures["run.jobs_failed"] == 0
    assert [kind for kind in STAGES if not figures[f"run.{kind}.complete"]] == []
    assert re.search(r"\d+ jobs run, 0 unchanged, 0 failed", run.said) and "dashboard: http://127.0.0.1:" in run.said


def test_no_worker_took_more_than_it_may(figures):
    assert figures["run.peak_memory"] < 1500


def test_a_second_run_does_nothing_and_quickly(copy):
    report = (copy.folder / "report.html").read_bytes()
    said = command("run", PROJECT)
    assert f"0 jobs run, {len(Records(copy.folder).sort_out()[0])} unchanged" in said
    assert int(re.search(r"failed in (\d+) s", said)[1]) < 15 and (copy.folder / "report.html").read_bytes() == report


def test_the_workflow_as_run_reproduces_the_run(copy):
    assert "0 jobs run" in command("run", f"runs/{PROJECT}/workflow.yaml")


def test_a_changed_texture_setting_runs_only_what_depends_on_it(copy):
    path = copy.root / "workflows" / f"{PROJECT}.yaml"
    path.write_text(path.read_text().replace("- kind: texture", "- kind: texture\n    rejection: {kind: none}"))
    command("run", PROJECT, "--sequential")
    figures = copy.summary()
    assert {kind for kind in STAGES if figures[f"run.{kind}.jobs_done"]} == {"texture", "viewer", "accuracy", "evaluation"}
    assert figures["run.evaluation.jobs_skipped"] > 10, "the heights do not depend on it and need no new evaluation"


def test_one_process_and_dask_agree_bit_for_bit(run, tmp_path):
    """One process: that of the tests, which has loaded libraries and kernels already."""
    shutil.copytree(run.root / "workflows", tmp_path / "workflows")
    command_in(tmp_path, "run", PROJECT, "--sequential")
    one, two = results_of(tmp_path, PROJECT), results_of(run.root, PROJECT)
    assert sorted(one) == sorted(two) and {name.split("/")[1] for name in one} >= set(STAGES)
    assert [name for name in one if one[name] != two[name]] == []
    alone = tmp_path / "runs" / PROJECT
    products = [path.relative_to(alone) for path in sorted((alone / "products").rglob("*")) if path.is_file()]
    assert [name for name in products if (run.folder / name).read_bytes() != (alone / name).read_bytes()] == []


# --- what was measured -------------------------------------------------------------------------------------------------------


def test_all_photographs_are_oriented(figures):
    assert (figures["orientation.photos_oriented"], figures["orientation.photos_unoriented"]) == (6, 0)


def test_projection_centres_are_within_three_of_their_standard_errors(figures):
    assert figures["evaluation.centres_within_3_sigma"] >= 95
    # Of the eight interior parameters k1 to k3 are correlated so strongly that they leave three standard errors together.
    assert figures["evaluation.rotations_within_3_sigma"] >= 95 and figures["evaluation.interior_within_3_sigma"] >= 60


def test_check_points_confirm_the_adjustment(figures):
    assert figures["orientation.check_count"] == 4
    assert figures["orientation.check_rmse_plan"] <= 0.35 and figures["orientation.check_rmse_height"] <= 0.6
    assert figures["orientation.check_by_predicted"] < 2, "the stated precision promises too much"


def test_heights_of_clear_ground(figures):
    assert figures["evaluation.dsm_clear_ground_nmad"] <= 0.3 * PARALLAX_HEIGHT
    assert figures["evaluation.dsm_clear_ground_completeness"] >= 92
    assert abs(figures["evaluation.dsm_clear_ground_bias"]) <= 3 * figures["orientation.ground_sigma_height"]


def test_heights_of_roofs(figures):
    assert figures["evaluation.dsm_buildings_judged"] >= 20
    assert figures["evaluation.dsm_roof_median_error"] <= 0.5


def test_water_stays_empty_rather_than_guessed(figures):
    assert figures["evaluation.dsm_water_left_empty"] >= 50


def test_what_looks_like_water_has_a_file_that_can_be_taken_over_as_outlines(run):
    # The pond of this scene is narrower than what "far and wide" means: nothing is named, and a layer without areas says so.
    assert json.loads((run.folder / "tables" / "densification" / "water_places.json").read_text())["places"] == []
    with pytest.raises(WorkflowError, match="no polygon"):
        read_outlines(run.folder / "products" / "water_candidates.gpkg", CRS)


def test_the_check_raises_no_false_alarm(figures):
    assert figures["dsm_check.checked"] >= 60 and abs(figures["dsm_check.dh_median"]) <= 0.1
    assert figures["dsm_check.suspicious_area"] <= 100


def test_the_orthoimage_lies_where_the_true_one_lies(figures):
    assert figures["evaluation.ortho_shift_nodes"] >= 300
    # Crowns of a few cells, which the surface smooths, are most of what is left of it, then cells beside walls that are estimates.
    assert figures["evaluation.ortho_shift_q95_px"] <= 0.55 and figures["evaluation.ortho_shift_above_half_px_share"] <= 6
    assert figures["evaluation.ortho_psnr"] >= 28


def test_the_orthoimage_has_neither_holes_nor_doubled_roofs(figures):
    assert figures["evaluation.ortho_completeness"] >= 99.5 and figures["texture.occluded_share"] <= 0.2
    assert figures["evaluation.ortho_doubled_share"] <= 0.5


def test_vehicles_are_suppressed_where_three_photographs_see_the_place(figures):
    assert figures["evaluation.ortho_roads_disturbed_3"] <= 1


# --- the products -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["dsm.tif", "dsm_check.tif", "dsm_provenance.tif", "ortho.tif", "ortho_height_source.tif"])
def test_a_product_opens_with_its_place_and_overviews(run, name):
    with rasterio.open(run.folder / "products" / name) as file:
        assert file.crs.to_epsg() == 2100
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert all(file.overviews(band) for band in file.indexes)
        assert 407_000 < file.bounds.left < file.bounds.right < 409_000


@pytest.mark.parametrize("name", ["dsm.tif", "dsm_check.tif", "ortho.tif"])
def test_a_product_says_where_it_has_nothing(run, name):
    with rasterio.open(run.folder / "products" / name) as file:
        if name == "ortho.tif":
            assert file.count == 4 and file.colorinterp[3] is ColorInterp.alpha
        else:
            assert np.isnan(file.nodata)
        assert 0.5 < (file.dataset_mask() > 0).mean() < 1.0


def test_heights_come_with_a_precision_of_their_own(run):
    with rasterio.open(run.folder / "products" / "dsm.tif") as file:
        height, precision = file.read(1), file.read(2)
    assert np.array_equal(np.isnan(height), np.isnan(precision))
    assert 0.02 < np.nanmedian(precision) < 0.3 * PARALLAX_HEIGHT


def test_cells_lie_on_the_surface(run):
    with rasterio.open(run.folder / "products" / "dsm.tif") as file:
        cells = int(np.isfinite(file.read(1)).sum())
        bounds = file.bounds
    points = laspy.read(run.folder / "products" / "dsm_cells.laz")
    assert len(points.x) == cells
    assert bounds.left < points.x.min() and points.x.max() < bounds.right
    assert points.header.parse_crs().to_epsg() == 2100


def test_matched_points_lie_near_the_surface(run):
    with rasterio.open(run.folder / "products" / "dsm.tif") as file:
        heights, inverse = file.read(1), ~file.transform
    points = laspy.read(run.folder / "products" / "points.laz")
    col, row = (np.floor(values).astype(int) for values in inverse * (np.array(points.x), np.array(points.y)))
    apart = np.abs(heights[row, col] - np.array(points.z))
    assert len(points) > 10_000 and np.nanmedian(apart) < 0.3 * PARALLAX_HEIGHT
    assert set(np.unique(points["code"])) <= set(MEASURED) and np.min(points["rays"]) >= 2
    assert {CellClass.GROUND, CellClass.BUILDING} <= set(np.unique(points.classification)) <= set(CellClass)


def test_cameras_are_the_block(run):
    block = Block.model_validate_json((run.folder / "products" / "cameras.json").read_bytes())
    assert len(block.photos) == 6 and all(photo.covariance is not None for photo in block.photos)


class Links(HTMLParser):
    """Gathers all that a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []

    def handle_starttag(self, tag, attributes):
        self.loaded += [value or "" for name, value in attributes if name in ("src", "srcset", "data", "poster")]
        self.loaded += [value or "" for name, value in attributes if tag == "link" and name == "href"]


def test_the_report_needs_no_network(run):
    page = (run.folder / "report.html").read_text()
    links = Links()
    links.feed(page)
    assert len(links.loaded) > 10 and all(link.startswith("data:") for link in links.loaded)
    assert not re.search(r"url\(\s*['\"]?(?!data:|#)|@import", page)
    assert "The photographs are simulated" in page


def test_dask_tells_how_it_went(run):
    page = (run.folder / "dask_report.html").read_text()
    assert "bokeh" in page.lower() and "densification" in page
