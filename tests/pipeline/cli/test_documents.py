"""What the pages of docs/ say of codes, formulae and files is what the code does."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from orthomill import __version__
from orthomill.pipeline.cli.commands.application import app
from orthomill.schemas.camera import Camera
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.surface import PROVENANCE_CODES
from orthomill.tasks.geometry.distortion import image_to_pixel
from orthomill.tasks.geometry.rotation import rotation_matrix

ROOT = Path(__file__).parents[3]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
CONVENTIONS = (ROOT / "docs" / "conventions.md").read_text()


@pytest.mark.parametrize("outcome", Outcome, ids=lambda outcome: outcome.name)
def test_every_outcome_is_in_the_conventions(outcome):
    assert f"| {int(outcome)} | {outcome.name} | {outcome.sentence} |" in CONVENTIONS


def test_every_provenance_code_is_in_the_conventions():
    for code, _, meaning in PROVENANCE_CODES:
        assert f"| {code} | {meaning} |" in CONVENTIONS


def test_the_rotation_matrix_that_is_written_out():
    so, co, sp, cp, sk, ck = (f(angle) for angle in (0.3, -0.2, 1.1) for f in (np.sin, np.cos))
    entries = re.findall(r"r\d\d = +(-?[a-z ]+?(?: [+-] [a-z ]+?)?)(?=  |\n)", CONVENTIONS)
    values = {"so": so, "co": co, "sp": sp, "cp": cp, "sk": sk, "ck": ck}
    written = [sum(_product(term, values) for term in re.findall(r"[+-]? ?[a-z]{2}(?: [a-z]{2})*", entry)) for entry in entries]
    assert np.allclose(np.reshape(written, (3, 3)), rotation_matrix(0.3, -0.2, 1.1), atol=1e-14)


def _product(term: str, values: dict[str, float]) -> float:
    return (-1.0 if term.startswith("-") else 1.0) * float(np.prod([values[name] for name in re.findall(r"[a-z]{2}", term)]))


def test_the_distortion_that_is_written_out():
    camera = Camera(name="a", width=101, height=81, c=100.0, k1=-0.2, k2=0.05, k3=0.01, p1=0.003, p2=-0.002)
    names = {name: camera.value(name) for name in ("k1", "k2", "k3", "p1", "p2")}
    for x, y in ((0.1, 0.2), (-0.3, 0.25)):
        r = np.hypot(x, y)
        lines = re.findall(r"[xy]_observed = (.*)", CONVENTIONS)
        found = [eval(_python(line), {"x": x, "y": y, "r": r, **names}) for line in lines]
        col, row = image_to_pixel(camera, np.array([[x, y]]) * camera.c)[0]
        assert found == pytest.approx([(col - 50) / camera.c, (40 - row) / camera.c], abs=1e-12)


def _python(formula: str) -> str:
    """Juxtaposition to products: "2 p1 x y" and "x (1 + k1 r^2)" as Python."""
    return re.sub(r"(?<=[\w)]) (?=[\w(])", " * ", formula.replace("^", "**"))


GENERATED = (ROOT / "docs" / "settings.md",)
"""pages that `make docs` makes"""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    made = GENERATED if page.parent.name == "docs" else ()  # the site has them; somebody who reads the README in the clone does not
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text()):
        if not target.startswith(("http", "docs/pictures/", "pictures/")) and page.parent / target not in made:
            assert (page.parent / target).exists(), f"{page.name} links to {target}, which is not there"


@pytest.mark.parametrize("page", GENERATED, ids=lambda page: page.name)
def test_a_generated_page_is_made_with_the_documentation_and_is_not_in_the_repository(page):
    name = page.relative_to(ROOT).as_posix()
    assert f" {name}\n" in (ROOT / "Makefile").read_text() and f"\n{name}\n" in (ROOT / ".gitignore").read_text()
    assert f": {page.name}\n" in (ROOT / "mkdocs.yml").read_text()
    assert not subprocess.run(["git", "ls-files", name], cwd=ROOT, capture_output=True, text=True).stdout


def test_the_command_tells_its_version():
    answer = CliRunner().invoke(app, ["--version"])
    assert answer.exit_code == 0 and answer.output.strip() == __version__
