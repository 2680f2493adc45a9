"""The stages `texture` and `evaluation` on the engine: the box scene from photos to figures."""

from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from box_scene import DSM, ORTHO, heights, true_ortho
from box_scene_stages import GIVEN, GivenStage
from pydantic import ValidationError

from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.project import Project
from orthomill.schemas.raster import Window
from orthomill.schemas.stage_report import StageReport, report_table
from orthomill.schemas.surface import ORTHO as ORTHO_RASTER
from orthomill.schemas.surface import Provenance
from orthomill.tasks.evaluation.stage import EvaluationStage
from orthomill.tasks.texture.stage import TextureStage


class Quiet:
    def planned(self, key): ...
    def skipped(self, key): ...
    def finished(self, finished, seconds): ...


def run(root: Path, *stages, tile: int = 128) -> Session:
    project = Project.model_validate(
        {"project": "box", "crs": "EPSG:2100", "photographs": {"kind": "folder", "path": "photos"}, "tile": tile}
    )
    session = Session(project, stages, root, lambda source: ())
    session.run(SequentialRunner(1500 * 2**20), Quiet())
    assert not session.failures
    return session


def report_of(root: Path, stage: str) -> StageReport:
    return Store(root / "runs" / "box").table(report_table(stage))


def figures(root: Path, stage: str) -> dict[str, object]:
    return {figure.name: figure.value for figure in report_of(root, stage).figures}


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("box")
    run(root, *GIVEN, TextureStage(), EvaluationStage())
    return root


def test_texture_reports_what_was_seen(finished):
    f = figures(finished, "texture")
    assert f["cell"] == 0.5 and f["seen_by_3_or_more"] > 98
    assert f["seen_by_0"] + f["seen_by_1"] + f["seen_by_2"] + f["seen_by_3_or_more"] == pytest.approx(100, abs=0.01)
    assert f["draped_share"] == pytest.approx(100 * 48 / 14400, abs=0.01) and f["height_share"] == 100 and f["missed_share"] == 0
    assert f["balance_difference_after"] < 0.25 * f["balance_difference_before"] and f["seam_difference"] < 3
    assert 0 < f["rejected_share"] < 1


def test_the_product_is_a_georeferenced_rgba_file(finished):
    with rasterio.open(finished / "runs/box/products/ortho.tif") as file:
        assert (
            file.count == 4 and file.crs.to_epsg() == 2100 and file.transform[0] == 0.5 and (file.height, file.width) == (240, 240)
        )
        assert (file.read(4) > 0).mean() > 0.99


def test_points_and_cells_are_coloured_clouds_with_classes(finished):
    points, cells = (laspy.read(finished / "runs/box/products" / name) for name in ("points.laz", "dsm_cells.laz"))
    assert len(points) == 120 * 120 and len(cells) == 120 * 120 - 48
    assert set(points.classification) == set(cells.classification) == {64 + Provenance.AGREED}
    roof = np.array(points.z) == 14
    assert (np.array(points.red)[roof] > 150 * 257).mean() > 0.95 and set(points["rays"]) == {2}


def test_evaluation_measures_the_noise_that_was_planted(finished):
    f = figures(finished, "evaluation")
    assert f["dsm_open_ground_nmad"] == pytest.approx(0.1, abs=0.01) and abs(f["dsm_open_ground_bias"]) < 0.01
    assert f["dsm_open_ground_completeness"] == pytest.approx(100 * (1 - 48 / 13828), abs=0.01)
    assert f["dsm_roof_median_error"] < 0.1 and f["dsm_buildings_within_half_metre"] == 100
    assert f["dsm_open_ground_within_1_sigma"] == pytest.approx(68.3, abs=2.5) and f["dsm_within_3_sigma"] > 99


def test_evaluation_finds_a_good_orthoimage(finished):
    f = figures(finished, "evaluation")
    assert f["ortho_psnr"] > 40 and f["ortho_ssim"] > 0.98 and f["ortho_shift_median_px"] < 0.15
    assert f["ortho_doubled_share"] < 1.0 and f["ortho_roads_disturbed_3"] < 0.1 and f["ortho_completeness"] > 99.5
    assert f["centre_rmse_plan"] == 0 and f["photos_compared"] == 4


def test_tiles_of_any_size_give_the_same_products(finished, tmp_path):
    run(tmp_path, *GIVEN, TextureStage(), EvaluationStage(), tile=512)
    one, other = (Store(root / "runs" / "box") for root in (finished, tmp_path))
    for name in (ORTHO_RASTER, "texture/coverage", "evaluation/dh", "evaluation/ortho_difference"):
        full = one.spec(name).full
        assert np.array_equal(one.read(name, full), other.read(name, full), equal_nan=True), name
    a, b = figures(finished, "evaluation"), figures(tmp_path, "evaluation")
    assert {k: v for k, v in a.items() if v is not None} == pytest.approx({k: v for k, v in b.items() if v is not None}, rel=1e-3)


def test_every_picture_shows_a_raster_that_exists(finished):
    store = Store(finished / "runs" / "box")
    for stage in ("texture", "evaluation"):
        assert all(store.has(picture.raster) for picture in report_of(finished, stage).pictures)


def write(path: Path, grid, bands: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=grid.rows,
        width=grid.cols,
        count=len(bands),
        dtype=bands.dtype,
        crs="EPSG:2100",
        transform=rasterio.Affine(*grid.transform),
    ) as file:
        file.write(bands)


def test_files_as_reference(tmp_path):
    write(tmp_path / "reference/dsm.tif", DSM, (heights() - 0.25)[None])
    write(tmp_path / "reference/ortho.tif", ORTHO, np.moveaxis(np.rint(true_ortho()).astype(np.uint8), -1, 0))
    x, y = np.meshgrid(*DSM.centres(Window(0, 0, *DSM.shape)))
    rows = [f"{a},{b},{c - 0.25},0.1" for a, b, c in zip(x[::7, ::7].flat, y[::7, ::7].flat, heights()[::7, ::7].flat, strict=True)]
    (tmp_path / "reference/points.csv").write_text("\n".join(["x,y,z,sigma_z", *rows]))
    files = {"dsm": "reference/dsm.tif", "ortho": "reference/ortho.tif", "points": "reference/points.csv"}
    reference = {"kind": "file", **files}
    run(tmp_path, *GIVEN[1:], TextureStage(), EvaluationStage(reference=reference))
    f = figures(tmp_path, "evaluation")
    assert f["dsm_bias"] == pytest.approx(0.25, abs=0.01) and f["dsm_nmad"] == pytest.approx(0.1, abs=0.01)
    assert f["ortho_psnr"] > 40 and "ortho_doubled_share" not in f and "photos_compared" not in f
    assert f["points_compared"] > 200 and f["points_bias"] == pytest.approx(0.25, abs=0.03)


def test_nothing_to_compare_with_is_said(tmp_path):
    run(tmp_path, *GIVEN[1:], EvaluationStage(reference={"kind": "none"}))
    report = report_of(tmp_path, "evaluation")
    assert not report.figures and "Nothing was compared" in report.warnings[0]


def test_truth_without_a_simulation_is_refused(tmp_path):
    with pytest.raises(WorkflowError, match="no stage 'simulation'"):
        run(tmp_path, *GIVEN[1:], EvaluationStage())


def test_an_ortho_cell_that_does_not_nest_is_refused(tmp_path):
    with pytest.raises(WorkflowError, match="must divide"):
        run(tmp_path, *GIVEN[1:], TextureStage(cell=0.3))


@pytest.mark.parametrize("wrong", [{"cell": -0.5}, {"tolerance": -1.0}, {"best": -1}, {"holes": {"kind": "fill"}}])
def test_wrong_settings_of_texture_are_refused(wrong):
    with pytest.raises(ValidationError):
        TextureStage(**wrong)


def test_draping_fills_the_hole_and_says_so(tmp_path):
    run(tmp_path, *GIVEN[1:], TextureStage(holes={"kind": "drape", "max_gap": 10.0}))
    f = figures(tmp_path, "texture")
    assert f["draped_share"] == pytest.approx(100 * 48 / 14400, abs=0.01) and f["height_share"] == 100


def test_settings_of_texture_reach_the_tiles(tmp_path):
    stage = TextureStage(rejection={"kind": "none"}, weights={"kind": "area_squared"}, balance={"kind": "none"}, best=2)
    run(tmp_path, *GIVEN[1:], stage)
    f = figures(tmp_path, "texture")
    assert f["rejected_share"] == 0 and f["balance_difference_after"] is None
    assert GivenStage(kind="photos").hole
