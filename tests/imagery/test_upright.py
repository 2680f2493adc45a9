"""The EXIF orientation against Pillow, and windows of the file against windows of the upright photograph."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageOps

from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.upright import exif_orientation, file_window, turned, upright, upright_shape

FLAGS = range(1, 9)


@pytest.mark.parametrize("flag", FLAGS)
def test_pixels_are_turned_as_pillow_turns_them(flag):
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    image = Image.fromarray(pixels)
    image.getexif()[0x0112] = flag
    expected = np.asarray(ImageOps.exif_transpose(image))
    assert np.array_equal(upright(pixels, flag), expected)
    assert upright_shape(flag, 5, 7) == expected.shape[:2]
    assert turned(flag) == (expected.shape[:2] != (5, 7))
    assert upright(pixels, flag).flags.c_contiguous


@settings(max_examples=60, deadline=None)
@given(flag=st.sampled_from(FLAGS), height=st.integers(1, 20), width=st.integers(1, 20), place=st.tuples(*[st.floats(0, 1)] * 4))
def test_the_window_of_the_file_holds_the_window_of_the_upright_photograph(flag, height, width, place):
    pixels = np.arange(height * width).reshape(height, width, 1)
    rows, cols = upright_shape(flag, height, width)
    row, col = int(place[0] * (rows - 1)), int(place[1] * (cols - 1))
    window = Window(row, col, 1 + int(place[2] * (rows - row - 1)), 1 + int(place[3] * (cols - col - 1)))
    read = pixels[file_window(window, flag, height, width).slices]
    assert np.array_equal(upright(read, flag), upright(pixels, flag)[window.slices])


@pytest.mark.parametrize("name", ["Orientation", "EXIF_Orientation"])
@pytest.mark.parametrize(("text", "flag"), [("6", 6), (" 8\0", 8), ("1", 1)])
def test_the_flag_is_read_under_both_names(name, text, flag):
    assert exif_orientation({name: text}) == flag


@pytest.mark.parametrize("tags", [{}, {"Orientation": ""}, {"Orientation": "0"}, {"Orientation": "9"}, {"Orientation": "up"}])
def test_without_a_valid_flag_a_photograph_counts_as_upright(tags):
    assert exif_orientation(tags) == 1
