"""Masks of hidden areas: in the frame of the file, with what the photograph's own mask hides."""

import cv2
import numpy as np
import pytest

from orthomill.pipeline.serving.marking.mask_images import MaskImages
from orthomill.schemas.marks import HiddenArea
from orthomill.schemas.photo import Photo
from orthomill.tasks.imagery.upright import upright
from orthomill.tasks.marking.hidden_areas import hidden_mask

AREA = HiddenArea(photo="a", corners=((2, 3), (9, 3), (9, 5), (2, 5)))


def masks(folder, orientation=1, **fields):
    photo = Photo(
        name="a", path="a.jpg", width=40, height=30, bands=3, dtype="uint8", camera="c", exif_orientation=orientation, **fields
    )
    return MaskImages(folder, folder / "masks", [photo], hidden_mask)


def written(folder):
    return cv2.imread(str(folder / "masks" / "a.png"), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_mask_is_in_the_frame_of_the_file(tmp_path, orientation):
    masks(tmp_path, orientation).write([AREA])
    shown = upright(written(tmp_path)[..., None], orientation)[..., 0]
    expected = np.full((30, 40), 255, np.uint8)
    expected[3:6, 2:10] = 0
    assert np.array_equal(shown, expected)


@pytest.mark.parametrize("mask_upright", [False, True])
def test_what_the_own_mask_hides_stays_hidden(tmp_path, mask_upright):
    own = np.full((30, 40), 255, np.uint8)
    own[20:, :] = 0
    in_file = own if mask_upright else np.ascontiguousarray(np.rot90(own))
    cv2.imwrite(str(tmp_path / "own.png"), in_file)
    masks(tmp_path, 6, mask="own.png", mask_upright=mask_upright, masked=True).write([AREA])
    shown = upright(written(tmp_path)[..., None], 6)[..., 0]
    assert (shown[20:] == 0).all() and (shown[3:6, 2:10] == 0).all() and (shown == 255).sum() == 20 * 40 - 3 * 8


def test_nothing_is_written_where_nothing_is_hidden(tmp_path):
    masks(tmp_path).write([])
    assert not (tmp_path / "masks").exists()
