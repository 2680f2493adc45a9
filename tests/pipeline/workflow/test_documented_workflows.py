"""Every block of YAML of the documentation that is a workflow has no mistake."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.catalogue import STAGES

ROOT = Path(__file__).parents[3]
PAGES = sorted([ROOT / "README.md", *(page for page in (ROOT / "docs").rglob("*.md") if "api" not in page.parts)])
BLOCKS = [
    (page, k, text)
    for page in PAGES
    for k, text in enumerate(re.findall(r"```yaml\n(.*?)```", page.read_text(), re.DOTALL))
    if re.search(r"^project:", text, re.MULTILINE)
]
FILE = re.compile(r"^[\w./-]+\.\w{2,4}$")


def named_files(value) -> set[str]:
    """The files that a workflow names, as far as their names show that."""
    if isinstance(value, dict):
        return set().union(*map(named_files, value.values()), set())
    if isinstance(value, list):
        return set().union(*map(named_files, value), set())
    return {value} if isinstance(value, str) and FILE.match(value) and "/" in value else set()


@pytest.fixture
def root(tmp_path):
    (tmp_path / "workflows").mkdir()
    return tmp_path


def written(root: Path, text: str) -> Path:
    """The workflow in a project where all its files lie."""
    content = yaml.safe_load(text)
    for name in named_files(content):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("stands for a file")
    photographs = root / content["photographs"]["path"]
    photographs.mkdir(parents=True, exist_ok=True)
    for name in ("a.jpg", "b.jpg", "a.tif", "b.tif"):
        Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(photographs / name)
    path = root / "workflows" / f"{content['project']}.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("page", "number", "text"), BLOCKS, ids=[f"{page.stem}-{k}" for page, k, _ in BLOCKS])
def test_workflows_of_the_documentation_have_no_mistake(root, page, number, text):
    loaded = load_workflow(written(root, text), STAGES)
    assert loaded.notes == () and loaded.stages


def test_the_test_itself_finds_a_mistake(root):
    assert len(BLOCKS) >= 5
    with pytest.raises(WorkflowError):
        load_workflow(written(root, BLOCKS[0][2].replace("stages:", "stagse:")), STAGES)


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent.name == "guides"], ids=lambda page: page.name)
def test_links_of_the_guides_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), f"{page.name} links to {target}, which is not there"
