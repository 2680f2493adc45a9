"""`orthomill accept --photos --block`: the workflow of an inspection, and what is refused."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio

from orthomill.pipeline.cli.lookups.inspected_block import inspection_workflow
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.survey_files.noted_origin import NotedOrigin, origin_note
from orthomill.tasks.catalogue import STAGES

PHOTOS = Path(__file__).parents[4] / "workflows" / "photographs" / "brighton"


def write_heights(path):
    place = {"crs": "EPSG:32634", "transform": rasterio.Affine(1, 0, 5e5, 0, -1, 4e6)}
    with rasterio.open(path, "w", driver="GTiff", width=4, height=4, count=1, dtype="float32", **place) as file:
        file.write(np.ones((1, 4, 4), np.float32))


@pytest.fixture
def root(tmp_path) -> Path:
    (tmp_path / "block.csv").write_text("photo,x,y,z,omega,phi,kappa\n")
    (tmp_path / "cameras.xml").write_text("<document/>")
    (tmp_path / "folder").mkdir()
    (tmp_path / "points.csv").write_text("name,x,y,z\n")
    (tmp_path / "marks.csv").write_text("name,photo,col,row\n")
    return tmp_path


def test_a_block_of_somebody_else_is_taken_as_it_is_and_all_points_are_in_its_control(root):
    given = root / "points.csv", root / "marks.csv"
    made = inspection_workflow(Path("Their DSM.tif"), (PHOTOS, root / "block.csv"), given, None, root, STAGES)
    assert made.project.project == "accept-their-dsm"
    assert made.project.control.points == "points.csv" and made.project.control.measurements == "marks.csv"
    kinds = {stage.kind: stage for stage in made.stages}
    assert kinds["orientation"].exterior.kind == "csv" and "densification" not in kinds


def test_photographs_without_tags_take_the_system_of_the_product_and_colmap_its_own_coordinates(root):
    (root / "plain").mkdir()
    for name in ("a", "b"):
        cv2.imwrite(str(root / "plain" / f"{name}.tif"), np.zeros((40, 60), np.uint8))
    write_heights(root / "dsm.tif")
    for name in ("cameras", "images"):
        (root / "folder" / f"{name}.txt").write_text("")
    seen, given = (root / "plain", root / "folder"), (root / "points.csv", None)
    made = inspection_workflow(root / "dsm.tif", seen, given, None, root, STAGES)
    assert made.project.crs == "EPSG:32634"
    assert next(stage for stage in made.stages if stage.kind == "orientation").exterior.placed == "project"


def test_an_export_of_a_project_here_says_where_it_is(root):
    """Photographs with positions would otherwise place the block by these."""
    (root / "handed" / "text").mkdir(parents=True)
    note = origin_note(NotedOrigin((5e5, 5.6e6, 0.0), "EPSG:32630"))
    for name in ("cameras", "images"):
        (root / "handed" / "text" / f"{name}.txt").write_text(note)
    made = inspection_workflow(Path("dsm.tif"), (PHOTOS, root / "handed"), (root / "points.csv", None), None, root, STAGES)
    exterior = next(stage for stage in made.stages if stage.kind == "orientation").exterior
    assert (made.project.crs, exterior.placed, exterior.images_path) == ("EPSG:32630", "project", "handed/text/images.txt")


@pytest.mark.parametrize(
    ("seen", "given", "part"),
    [
        ((PHOTOS, None), ("points.csv", None), "belong together"),
        ((PHOTOS, "block.csv"), (None, None), "Give the surveyed points"),
        ((PHOTOS, "block.csv"), ("points.csv", "lost.csv"), "There are no marks"),
        ((PHOTOS, "lost.json"), ("points.csv", None), "There is no block"),
        ((PHOTOS, "cameras.xml"), ("points.csv", None), "is no block that can be read.*Omega Phi Kappa"),
        ((PHOTOS, "folder"), ("points.csv", None), "holds no cameras.txt and images.txt"),
    ],
)
def test_refusals_are_one_sentence(root, seen, given, part):
    photos, block, points, marks = (path and root / path for path in (*seen, *given))
    with pytest.raises(WorkflowError, match=part):
        inspection_workflow(Path("dsm.tif"), (photos, block), (points, marks), None, root, STAGES)
