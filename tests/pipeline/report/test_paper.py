"""The report on paper: A4 by a browser of this machine, and a sentence where there is none."""

import re
import shutil
from pathlib import Path

import pytest

from orthomill.pipeline import report
from orthomill.pipeline.report import paper
from orthomill.pipeline.report.paper import BROWSERS, write_pdf
from orthomill.schemas.errors import ResourceError

TEMPLATES = Path(report.__file__).parent / "templates"


def test_without_a_browser_it_is_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(paper, "LIBRARY", "no_library_of_this_name")
    with pytest.raises(ResourceError, match="no Chromium, Chrome or Edge"):
        write_pdf(tmp_path / "report.html")
    assert not paper.can_print()


def test_a_library_prints_without_a_browser_and_gets_blocks_for_columns(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    (tmp_path / "printer_of_a_test.py").write_text(
        "class HTML:\n"
        "    def __init__(self, string, base_url): self.text = string\n"
        "    def write_pdf(self, target): target.write_text(self.text)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(paper, "LIBRARY", "printer_of_a_test")
    page = tmp_path / "report.html"
    page.write_text("<style>p { margin: 0 }</style><p>one")
    assert paper.can_print() and ".answers dd" in write_pdf(page).read_text()


def test_a_browser_that_prints_nothing_is_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: shutil_true)
    with pytest.raises(ResourceError, match="printed nothing"):
        write_pdf(tmp_path / "report.html")


shutil_true = shutil.which("true")


def test_the_paper_is_a4(tmp_path):
    if not any(shutil.which(name) for name in BROWSERS):
        pytest.skip("There is no Chromium on this machine to print with.")
    page = tmp_path / "report.html"
    page.write_text("<!doctype html><style>@page { size: A4 }</style><p>one")
    content = write_pdf(page).read_bytes()
    width, height = (float(number) for number in re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", content).groups())
    assert content.startswith(b"%PDF") and (round(width), round(height)) == (595, 842)


def test_what_the_products_are_worth_is_unfolded_on_paper(tmp_path):
    if not any(shutil.which(name) for name in BROWSERS):
        pytest.skip("There is no Chromium on this machine to print with.")
    script = re.search(r'addEventListener\("beforeprint".*', (TEMPLATES / "report.html").read_text())[0]
    page = tmp_path / "report.html"
    folded = '<details class="{}"><summary>more</summary><p style="height: 20cm">long<p style="height: 20cm">longer</details>'
    pages = []
    for name in ("other", "on-paper"):
        page.write_text(f"<!doctype html><style>@page {{ size: A4 }}</style>{folded.format(name)}<script>{script}</script>")
        pages.append(write_pdf(page).read_bytes().count(b"/Type /Page\n"))
    assert pages == [1, 2]
