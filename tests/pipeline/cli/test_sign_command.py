"""`orthomill sign` on a small real project: what is shown, what is asked, what is refused, and what the report says then."""

import os
from dataclasses import replace

import pytest
from small_site import command, copy_of_finished_site, make_site
from typer.testing import CliRunner

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.cli.projects import load_project
from orthomill.pipeline.cli.sign import Person, sign_project, signing_lines
from orthomill.pipeline.engine.run_facts import read_facts, write_facts
from orthomill.pipeline.report.first_page import FirstPage
from orthomill.pipeline.signing.signature import SIGNATURE, read_signature
from orthomill.pipeline.signing.statement import Signer
from orthomill.pipeline.workflow.workflow_checks import named_inputs
from orthomill.schemas.errors import StoreError
from orthomill.schemas.project import ControlFromFiles

WHO = ("--name", "A. Surveyor", "--role", "licensed")


@pytest.fixture
def done(tmp_path, monkeypatch):
    """A copy of the finished project; the current folder. Its signer has no key yet."""
    monkeypatch.chdir(copy_of_finished_site(tmp_path / "copy"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))
    return tmp_path / "copy" / "runs" / "site"


def answer(text: str, *words: str):
    return CliRunner().invoke(app, ["sign", "site", *WHO, *words], input=text)


def test_figures_are_shown_asked_for_and_signed(done, tmp_path):
    summary = (done / "summary.json").read_bytes()
    asked = answer("y\n", "--remarks", "weak in the north")
    assert asked.exit_code == 0
    assert "Reference system: " in asked.output and "sign these figures" in asked.output
    assert (done / SIGNATURE).exists() and (tmp_path / "settings" / "orthomill" / "signing_key.pem").exists()
    assert (done / "summary.json").read_bytes() == summary
    said = command("verify", "site")
    assert "are whole" in said and "the signature of A. Surveyor, licensed" in said and "holds" in said
    page = (done / "report.html").read_text()
    assert "Signed by <b>A. Surveyor</b>, licensed" in page and "weak in the north" in page


def test_the_classes_of_all_products_are_looked_at():
    page = FirstPage(
        "good", "Good: nothing puts the results in doubt.", (), (), (("Area of the surface", "1 ha"),), (), classes=("dsm: 5 cm",)
    )
    assert list(signing_lines(page)) == ["Good: nothing puts the results in doubt.", "Area of the surface: 1 ha", "dsm: 5 cm"]


def test_whoever_declines_signs_nothing(done):
    declined = answer("n\n")
    assert declined.exit_code == 1 and "not signed" in declined.output and not (done / SIGNATURE).exists()


def test_a_second_signature_uses_the_same_key(done):
    first, second = (command("sign", "site", *WHO, "--yes") and (done / SIGNATURE).read_text() for _ in range(2))
    assert first.split('"public_key"')[1].split(",")[0] == second.split('"public_key"')[1].split(",")[0]


def test_a_product_that_changed_is_told_by_verify_and_by_the_report(done):
    command("sign", "site", *WHO, "--yes")
    (done / "products" / "later.txt").write_text("added by hand")
    said = command("verify", "site", code=1)
    assert "products/later.txt was made later" in said and "no longer belongs to these results" in said
    command("report", "site")
    assert "products/later.txt was made later" in (done / "report.html").read_text()


def test_what_is_damaged_is_not_signed(done):
    chunk = next(path for path in sorted((done / "rasters.zarr").glob("photos/**/c/**/*")) if path.is_file())
    chunk.write_bytes(chunk.read_bytes()[:-1])
    assert "are damaged" in command("sign", "site", *WHO, "--yes", code=2) and not (done / SIGNATURE).exists()


def test_what_was_never_run_is_not_signed(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path / "fresh"))
    assert "has not been run yet" in command("sign", "site", *WHO, code=2)


def test_an_incomplete_project_is_not_signed(done):
    write_facts(done, replace(read_facts(done), finished=None))
    assert "is not complete" in command("sign", "site", *WHO, "--yes", code=2)


@pytest.mark.parametrize("who", [("--name", " ", "--role", "licensed"), ("--name", "A", "--role", "")])
def test_a_signature_needs_a_name_and_a_role(done, who):
    assert "needs the name and the role" in command("sign", "site", *who, "--yes", code=2)


def test_an_input_that_was_written_after_the_run_is_not_signed(done):
    loaded = load_project("site")
    control = ControlFromFiles(kind="files", points="points.csv", measurements="marks.csv")
    changed = replace(loaded, project=loaded.project.model_copy(update={"control": control}))
    assert list(named_inputs(changed.project)) == ["points.csv", "marks.csv"]
    for name in ("points.csv", "marks.csv"):
        (loaded.root / name).write_text("written later")
    signer, person = Signer(name="A. Surveyor", role="licensed"), Person(lambda page: True, str)
    with pytest.raises(StoreError, match=r"points\.csv was written after site was run"):
        sign_project(changed, signer, None, person)
    for name in ("points.csv", "marks.csv"):
        os.utime(loaded.root / name, (0, 0))
    assert sign_project(changed, signer, None, person) == done / SIGNATURE
    assert set(read_signature(done).statement.inputs) == {"points.csv", "marks.csv"}
