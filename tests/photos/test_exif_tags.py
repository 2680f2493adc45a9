"""EXIF text to numbers: every form in which cameras write a tag, and what counts as absent."""

import pytest

from orthomill.tasks.photos import exif
from orthomill.tasks.photos.sensors import SENSOR_WIDTH_MM, sensor_width_mm


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("(3.61)", [3.61]),
        ("(46) (50) (33.3855)", [46.0, 50.0, 33.3855]),
        ("+90.00", [90.0]),
        ("-1.5e2", [-150.0]),
        ("f/2.8", [2.8]),
        ("", []),
        ("none", []),
        ("2.", [2.0]),
    ],
)
def test_numbers_of_a_tag(text, found):
    assert exif.numbers({"T": text}, "T") == found


@pytest.mark.parametrize(("text", "value"), [("(50)", 50.0), ("(0)", None), ("-3", None), ("", None), ("unknown", None)])
def test_zero_and_negative_lengths_count_as_absent(text, value):
    assert exif.positive({"FocalLength": text}, "FocalLength") == value
    assert exif.positive({}, "FocalLength") is None


@pytest.mark.parametrize(("unit", "size"), [("2", 25.4), ("3", 10.0), ("4", 1.0), ("5", 0.001), (None, 25.4)])
def test_focal_plane_units(unit, size):
    tags = {"FocalPlaneXResolution": "(2540)"} | ({} if unit is None else {"FocalPlaneResolutionUnit": unit})
    assert exif.focal_plane_pixel_um(tags, 4000) == pytest.approx(1000.0 * size / 2540)


@pytest.mark.parametrize(
    "tags", [{}, {"FocalPlaneXResolution": "(0)"}, {"FocalPlaneXResolution": "(9)", "FocalPlaneResolutionUnit": "9"}]
)
def test_without_a_usable_resolution_there_is_no_pixel_size(tags):
    assert exif.focal_plane_pixel_um(tags, 4000) is None


def test_sensor_widths_are_found_whatever_the_case_and_padding():
    assert sensor_width_mm(" fc6310 ") == 13.2 and sensor_width_mm("unheard of") is None
    assert all(name == name.upper().strip() and 4.0 < width < 37.0 for name, width in SENSOR_WIDTH_MM.items())
