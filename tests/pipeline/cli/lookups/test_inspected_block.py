"""`orthomill accept --photos --block`: the workflow of an inspection, and what is refused."""

from pathlib import Path

import pytest

from orthomill.pipeline.cli.lookups.inspected_block import inspection_workflow
from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.catalogue import STAGES

PHOTOS = Path(__file__).parents[4] / "workflows" / "photographs" / "brighton"


@pytest.fixture
def root(tmp_path) -> Path:
    (tmp_path / "block.csv").write_text("photo,x,y,z,omega,phi,kappa\n")
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


@pytest.mark.parametrize(
    ("seen", "given", "part"),
    [
        ((PHOTOS, None), ("points.csv", None), "belong together"),
        ((PHOTOS, "block.csv"), (None, None), "Give the surveyed points"),
        ((PHOTOS, "block.csv"), ("points.csv", "lost.csv"), "There are no marks"),
        ((PHOTOS, "lost.json"), ("points.csv", None), "There is no block"),
    ],
)
def test_refusals_are_one_sentence(root, seen, given, part):
    photos, block, points, marks = (path and root / path for path in (*seen, *given))
    with pytest.raises(WorkflowError, match=part):
        inspection_workflow(Path("dsm.tif"), (photos, block), (points, marks), None, root, STAGES)
