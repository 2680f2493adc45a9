"""The notebooks of the documentation do what they say, cell by cell, and so does `orthomill.open` on a finished project."""

import json
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from small_site import make_site

import orthomill

pytestmark = pytest.mark.slow

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"


def executed(name: str, monkeypatch, tmp_path) -> dict[str, Any]:
    """The names that a notebook leaves behind after all of its code has run."""
    matplotlib.use("agg")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", plt.close)
    cells = json.loads((NOTEBOOKS / name).read_text())["cells"]
    names: dict[str, Any] = {}
    for number, cell in enumerate(cells):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{name} cell {number}", "exec"), names)
    return names


def test_every_notebook_is_run_by_a_test():
    assert {path.name for path in NOTEBOOKS.glob("*.ipynb")} == {"orient_your_photographs.ipynb", "why_this_height.ipynb"}


def test_photographs_are_oriented_and_their_residuals_drawn(monkeypatch, tmp_path):
    monkeypatch.setenv("ORTHOMILL_PHOTOS", str(make_site(tmp_path) / "photos"))
    names = executed("orient_your_photographs.ipynb", monkeypatch, tmp_path)
    assert len(names["block"].photos) == 3
    assert all(0.01 < value < 1.0 for value in names["rms"])


def test_the_patches_of_a_height_agree_best_near_it(run, monkeypatch, tmp_path):
    monkeypatch.setenv("ORTHOMILL_RUN", str(run.folder))
    names = executed("why_this_height.ipynb", monkeypatch, tmp_path)
    assert len(names["seen"]) >= 2
    assert abs(names["best"] - names["height"]) < 1.5
    assert names["curve"].max() > names["agreement"](names["wrong"]) + 0.05


def test_a_finished_project_opens_with_its_rasters_as_maps(run):
    project = orthomill.open(run.folder)
    height = project.raster("densification/height")
    assert height.dims == ("y", "x") and height.chunks is not None
    assert project.raster("texture/ortho").dims == ("y", "x", "band")
    assert project.raster(f"photos/{project.photographs.names[0]}/0").dims == ("row", "col", "band")
    assert project.covariance(project.block.names[0]).shape == (6, 6)
    assert project.block.sigma0_px == pytest.approx(project.summary["orientation.sigma0_px"]["value"], rel=0.01)
    low, high = float(height.min()), float(height.max())
    assert np.isfinite([low, high]).all() and low < np.median(project.points.z) < high
