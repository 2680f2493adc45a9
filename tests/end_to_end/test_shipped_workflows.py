"""Every workflow that is shipped can be planned as it is, and planning leaves no trace."""

from pathlib import Path

import pytest
from small_site import command
from whole_plan import plan_whole

from orthomill.pipeline.engine.running import session_of
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.tasks.catalogue import STAGES

WORKFLOWS = Path(__file__).parents[2] / "workflows"


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A root of its own with all that is shipped; the current folder."""
    (tmp_path / "workflows").symlink_to(WORKFLOWS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", sorted(path.stem for path in WORKFLOWS.glob("*.yaml")))
def test_a_shipped_workflow_can_be_planned(root, name):
    if name == "wall" and not any(WORKFLOWS.glob("photographs/wall/*.jpg")):
        pytest.skip("the photographs of the wall state no licence and are not shipped; see workflows/photographs/wall/README.md")
    said = command("plan", name)
    assert "not done yet" in said and "orientation" in said
    assert [path.name for path in root.iterdir()] == ["workflows"]


WAITING = {"portal": {"projection"}, "buddha": {"projection"}}
"""what only the mesh itself tells: into how many blocks it is cut"""


@pytest.mark.parametrize("name", ["volos_small", "volos", "volos_second", "brighton", "portal", "buddha"])
def test_a_shipped_workflow_can_be_planned_to_its_last_job(root, name):
    """Without doing one: what a later stage would refuse after hours is found in seconds. volos_full has the stages of volos."""
    session = session_of(load_workflow(root / "workflows" / f"{name}.yaml", STAGES))
    plan_whole(session)
    waiting = set(session.planner.waiting_for)
    assert waiting == WAITING.get(name, set())
    planned = {key[0] for key in session.graph.jobs}
    assert planned == {stage.kind for stage in session.stages}
    assert all(0 < job.memory < 1500 * 2**20 for job in session.graph.jobs.values())
    assert [path.name for path in root.iterdir()] == ["workflows"]


def test_the_five_projects_are_shipped():
    assert {path.stem for path in WORKFLOWS.glob("*.yaml")} >= {"volos", "volos_second", "volos_small", "volos_full", "brighton"}


def test_the_full_scene_fits_the_memory_of_a_worker(root):
    session = session_of(load_workflow(root / "workflows" / "volos_full.yaml", STAGES))
    session.plan()
    sides = {spec.shape[0] for name, spec in session.graph.specs.items() if name.startswith("simulation/") and "volos" in name}
    assert sides == {15333}
    assert max(planned.memory for planned in session.pending) < 1500 * 2**20
