"""`orthomill check` and `orthomill change`: the workflow that they make, and their refusals."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin
from typer.testing import CliRunner

from orthomill.pipeline.cli.check_surface import CheckOptions, change_workflow, check_name, check_workflow
from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.catalogue import STAGES

PHOTOS = Path(__file__).parents[3] / "workflows" / "photographs" / "brighton"


@pytest.fixture
def root(tmp_path) -> Path:
    top = tmp_path / "top"
    top.mkdir()
    with rasterio.open(
        tmp_path / "Old Model.tif", "w", "GTiff", 20, 20, 1, "EPSG:32615", from_origin(576_600, 5_188_300, 10, 10), "float32"
    ) as target:
        target.write(np.full((1, 20, 20), 160.0, np.float32))
    return top


def test_photographs_and_a_surface_of_other_folders_are_enough(root):
    surface = root.parent / "Old Model.tif"
    loaded = check_workflow(check_name(surface), surface, CheckOptions(photos=PHOTOS), root, STAGES)
    assert loaded.project.project == "check-old-model" and loaded.project.crs == "EPSG:32615"
    kinds = [stage.kind for stage in loaded.stages]
    assert kinds == ["photos", "calibration", "tie_points", "orientation", "epipolar", "dsm_check"]
    assert loaded.stages[-1].surface.kind == "file" and loaded.stages[-2].images == "none"
    # What was written is a workflow like any other: it loads, and names only what is inside of the folder.
    again = load_workflow(root / "workflows" / "check-old-model.yaml", STAGES)
    assert again.stages == loaded.stages and (root / again.stages[-1].surface.path).resolve() == surface.resolve()


def test_a_block_takes_the_place_of_the_orientation(root):
    (root / "block.csv").write_text("photo,x,y,z,omega,phi,kappa\n")
    given = CheckOptions(photos=PHOTOS, block=root / "block.csv", remove_shift=True, fill=True, sigma=0.2)
    stages = check_workflow("one", root.parent / "Old Model.tif", given, root, STAGES).stages
    assert stages[3].exterior.kind == "csv" and {"tie_points", "densification"} <= {stage.kind for stage in stages}
    surface = stages[-1].surface
    assert (surface.shift, surface.holes, surface.sigma) == ("remove", "fill", 0.2)


def test_an_orthoimage_of_the_corrected_surface_needs_no_matched_one(root):
    given = CheckOptions(photos=PHOTOS, ortho=True)
    kinds = [stage.kind for stage in check_workflow("one", root.parent / "Old Model.tif", given, root, STAGES).stages]
    assert kinds[-2:] == ["dsm_check", "texture"] and "densification" not in kinds


def test_a_project_calibrated_with_chessboards_lends_its_camera(root):
    folder = root / "runs" / "town"
    (folder / "products").mkdir(parents=True)
    (folder / "products" / "cameras.json").write_text("{}")
    shutil.copy(PHOTOS.parents[1] / "volos_small.yaml", folder / "workflow.yaml")
    made = check_workflow("one", root.parent / "Old Model.tif", CheckOptions(project="town"), root, STAGES).project
    assert made.cameras.model_dump() == {"kind": "file", "path": "runs/town/products/camera.json", "serves": "*"}
    assert made.photographs.path == "runs/town/photographs"


def test_the_area_of_a_project_bounds_its_check_and_the_command_line_names_another(root):
    folder = root / "runs" / "town"
    (folder / "products").mkdir(parents=True)
    (folder / "products" / "cameras.json").write_text("{}")
    text = (PHOTOS.parents[1] / "volos_small.yaml").read_text()
    (folder / "workflow.yaml").write_text(f"{text}\ngrid: {{kind: map, area: [407900, 4356900, 408100, 4357050], cell: 0.5}}\n")
    surface = root.parent / "Old Model.tif"
    made = check_workflow("one", surface, CheckOptions(project="town"), root, STAGES).project
    assert made.grid.area == (407900, 4356900, 408100, 4357050) and made.grid.cell == "auto"
    other = CheckOptions(project="town", area=(0, 0, 1, 1))
    assert check_workflow("one", surface, other, root, STAGES).project.grid.area == (0, 0, 1, 1)
    (root.parent / "site.geojson").write_text("{}")
    drawn = check_workflow("one", surface, CheckOptions(photos=PHOTOS, cutline=root.parent / "site.geojson"), root, STAGES)
    assert str(drawn.project.grid.area).startswith("linked/")


def test_a_workflow_of_somebody_else_is_not_overwritten(root):
    (root / "workflows").mkdir()
    (root / "workflows" / "mine.yaml").write_text("project: mine\n")
    with pytest.raises(WorkflowError, match="not overwritten"):
        check_workflow("mine", root.parent / "Old Model.tif", CheckOptions(photos=PHOTOS), root, STAGES)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["missing.tif", "--photos", "x"], "There is no surface"),
        (["../Old Model.tif"], "Give the photographs with --photos"),
        (["../Old Model.tif", "--project", "none"], "holds no oriented photographs"),
        (["../Old Model.tif", "--photos", str(PHOTOS), "--block", "no.json"], "There is no block"),
        (["../Old Model.tif", "--photos", str(PHOTOS), "--crs", "EPSG:4326"], "is in degrees"),
        (["../Old Model.tif", "--photos", str(PHOTOS), "--cutline", "no.gpkg"], "There are no polygons"),
        (["../Old Model.tif", "--photos", str(PHOTOS), "--area", "5", "5", "1", "9"], "has no inside"),
    ],
)
def test_refusals_are_one_sentence(root, monkeypatch, arguments, part):
    monkeypatch.chdir(root)
    answer = CliRunner().invoke(app, ["check", *arguments])
    assert answer.exit_code == 2 and part in " ".join(answer.output.split())


def test_a_mesh_is_refused_with_the_way_to_a_height_model(root):
    (root / "wall.ply").write_text("ply\n")
    with pytest.raises(WorkflowError, match=r"wall\.ply is a mesh.*upper side"):
        check_workflow("one", root / "wall.ply", CheckOptions(photos=PHOTOS), root, STAGES)


def test_an_earlier_epoch_in_sheets_is_asked_for_as_one_file(root):
    products = root / "runs/before/products"
    products.mkdir(parents=True)
    (products / "dsm.vrt").write_text("<VRTDataset/>")
    with pytest.raises(WorkflowError, match=r"dsm\.vrt joins sheets.*--as geotiff"):
        change_workflow("before", "after", None, 0.1, root, STAGES)


def test_change_needs_an_earlier_epoch(root):
    with pytest.raises(WorkflowError, match="neither a surface"):
        change_workflow("before", "after", None, 0.0, root, STAGES)
    with pytest.raises(WorkflowError, match="holds no oriented photographs"):
        change_workflow(str(root.parent / "Old Model.tif"), "after", None, 0.1, root, STAGES)
