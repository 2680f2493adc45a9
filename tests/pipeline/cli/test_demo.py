"""What a stranger meets first: an embedded project without a checkout, and names that the shell completes."""

from pathlib import Path

from orthomill.pipeline.cli.demo import WORKFLOW, write_demo
from orthomill.pipeline.cli.terminal import project_names
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.tasks.catalogue import STAGES

ROOT = Path(__file__).parents[3]


def test_the_demo_is_a_workflow_that_can_be_run_anywhere(tmp_path):
    path = write_demo(tmp_path)
    assert load_workflow(path, STAGES).project.project == "volos_small"


def test_a_workflow_that_the_user_has_changed_is_not_overwritten(tmp_path):
    path = write_demo(tmp_path)
    path.write_text("changed")
    assert write_demo(tmp_path).read_text() == "changed"


def test_the_demo_is_the_project_of_the_checkout():
    assert (ROOT / "pipeline" / "cli" / WORKFLOW).read_text() == (ROOT / "workflows" / WORKFLOW).read_text()


def test_the_shell_completes_names_of_projects(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert project_names("") == []
    write_demo(tmp_path)
    (tmp_path / "workflows" / "site.yaml").touch()
    assert project_names("") == ["site", "volos_small"] and project_names("vo") == ["volos_small"]
