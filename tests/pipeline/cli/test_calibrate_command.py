"""The command `orthomill calibrate` on a small set of rendered photographs, and its refusals."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from benchmarks.calibration.board_setups import SIX_BOARDS, places_of, views_of
from orthomill.pipeline.cli.commands.application import app
from orthomill.schemas.raster import Window
from orthomill.tasks.simulation.boards.board_rendering import BoardFilm, photograph_floor

CAMERA = SIX_BOARDS.camera.model_copy(update={"width": 720, "height": 480}).changed(c=610.0, x0=3.0, y0=-2.0, k1=-0.1, k2=0.03)
SETUP = replace(SIX_BOARDS, camera=CAMERA, boards=3, photos=6, share=0.7, seed=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("boards")
    (root / "photos").mkdir()
    for number, view in enumerate(views_of(SETUP)):
        image = photograph_floor(view, places_of(SETUP), SETUP.board, BoardFilm(0.6, 2.0, seed=number), Window(0, 0, 480, 720))
        cv2.imwrite(str(root / "photos" / f"{view.name}.png"), image)
    return root


def called(folder: Path, monkeypatch, *more: str):
    monkeypatch.chdir(folder)
    return CliRunner().invoke(app, ["calibrate", "photos", "--square", "0.0359", "--sequential", *more])


@pytest.mark.slow
def test_a_camera_comes_out_with_its_precision_files_and_report(folder, monkeypatch):
    answer = called(folder, monkeypatch, "--boards", "3", "--corners", "6x5", "--name", "lens")
    assert answer.exit_code == 0, answer.output
    products = folder / "runs" / "lens" / "products"
    camera = json.loads((products / "camera.json").read_text())
    sigma = camera["covariance"][0][0] ** 0.5
    assert abs(camera["c"] - 610.0) < 4 * sigma < 2.0
    assert {path.name for path in products.iterdir()} >= {
        "camera_opencv.yaml",
        "camera_colmap.txt",
        "camera_opensfm.json",
        "camera_agisoft.xml",
        "calibration.json",
    }
    page = (folder / "runs" / "lens" / "report.html").read_text()
    assert "Balanced radial distortion" in page and "Boards in board_01" in page and "Correlations of the interior" in page
    assert "sigma0" in answer.output


@pytest.mark.parametrize(
    ("more", "part"),
    [
        (("--corners", "7x2"), "at least 3"),
        (("--corners", "many"), "columns x rows"),
        (("--corners", "6x5", "--arrangement", "heap"), "--arrangement"),
        (("--corners", "6x5", "--parameters", "x0"), "must hold c"),
        (("--corners", "6x5", "--parameters", "c,focus"), "--parameters"),
    ],
)
def test_what_cannot_be_calibrated_is_one_sentence(folder, monkeypatch, more, part):
    answer = called(folder, monkeypatch, *more, "--name", "wrong")
    assert answer.exit_code != 0 and part in answer.output, answer.output
    assert "Traceback" not in answer.output


def test_a_photograph_that_is_not_there_is_named(folder, monkeypatch):
    monkeypatch.chdir(folder)
    answer = CliRunner().invoke(app, ["calibrate", "nothing.jpg", "--corners", "6x5", "--square", "0.03"])
    assert answer.exit_code == 2 and "nothing.jpg" in answer.output
