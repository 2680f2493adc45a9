"""`orthomill inspect targets`: a coded target is listed with its centre; a file that is no photograph has no table."""

import cv2
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from orthomill.pipeline.cli.commands.application import app

TAG, COL, ROW = 80, 60, 100
"""px: side of the tag, and its upper left corner"""


def inspect(path, code=0):
    result = CliRunner().invoke(app, ["inspect", "targets", str(path)])
    assert result.exit_code == code, result.output
    return result.output.splitlines()


def test_a_tag_is_named_with_its_centre_and_standard_error(tmp_path):
    picture = np.full((300, 300), 200, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    picture[ROW : ROW + TAG, COL : COL + TAG] = cv2.aruco.generateImageMarker(dictionary, 7, TAG)
    Image.fromarray(cv2.GaussianBlur(picture, (0, 0), 0.8)).save(tmp_path / "tag.png")
    head, *rows = inspect(tmp_path / "tag.png")
    assert head == "name,kind,col,row,sigma,radius,score"
    (tag,) = (row.split(",") for row in rows if row.split(",")[0])
    assert tag[0] == "tag36h11-7"
    assert (float(tag[2]), float(tag[3])) == pytest.approx((COL + TAG / 2 - 0.5, ROW + TAG / 2 - 0.5), abs=0.05)
    assert 0 < float(tag[4]) < 0.2


def test_a_file_that_is_no_photograph_is_one_sentence_and_no_table(tmp_path):
    (tmp_path / "text.jpg").write_text("no picture")
    (said,) = inspect(tmp_path / "text.jpg", code=2)
    assert said.startswith("error: ") and "not a JPEG" in said
