"""EXIF text to numbers: every form in which cameras write a tag, and what counts as absent."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.geometry.rotation import rotation_matrix
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


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 89), st.integers(0, 59), st.floats(0, 59.99), st.booleans())
def test_degrees_minutes_and_seconds_add_up(degrees, minutes, seconds, south):
    tags = {
        "GPSLatitude": f"({degrees}) ({minutes}) ({seconds:.6f})",
        "GPSLatitudeRef": "S" if south else "N",
        "GPSLongitude": "(12.5)",
        "GPSLongitudeRef": "E",
    }
    expected = (degrees + minutes / 60 + round(seconds, 6) / 3600) * (-1 if south else 1)
    assert exif.longitude_latitude(tags) == pytest.approx((12.5, expected), abs=1e-9)


def test_a_sign_in_place_of_the_reference_is_understood():
    assert exif.longitude_latitude({"GPSLatitude": "(-33.5)", "GPSLongitude": "(-70.25)"}) == (-70.25, -33.5)


@pytest.mark.parametrize(
    ("tags", "height"),
    [
        ({}, None),
        ({"GPSAltitude": "(120.5)"}, 120.5),
        ({"GPSAltitude": "(120.5)", "GPSAltitudeRef": "1"}, -120.5),
        ({"GPSAltitude": "(0)"}, None),  # 0/0 is shown like this, and receivers without a height write it
        ({"GPSAltitude": "(4e+09)"}, None),
        ({"GPSAltitude": "(1e400)"}, None),
    ],
)
def test_altitudes(tags, height):
    assert exif.altitude(tags) == height


@settings(max_examples=60, deadline=None)
@given(yaw=st.floats(-179, 179), pitch=st.floats(-89, -1))
def test_the_axis_of_a_gimbal_points_where_yaw_and_pitch_say(yaw, pitch):
    """Heading and inclination of the viewing direction, computed back from the rotation matrix; the x axis stays level."""
    angles = exif.gimbal_attitude({"GimbalYawDegree": f"{yaw:.8f}", "GimbalPitchDegree": f"{pitch:.8f}"})
    rotation = rotation_matrix(*np.radians(angles))
    forward = -rotation[2]
    assert np.degrees(np.arcsin(forward[2])) == pytest.approx(pitch, abs=1e-6)
    turn = np.degrees(np.arctan2(forward[0], forward[1])) - yaw
    assert (turn + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-5)
    assert rotation[0, 2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("tags", "time"),
    [
        ({"DateTimeOriginal": "2016:06:23 16:31:59"}, "2016-06-23T16:31:59"),
        ({"DateTime": "2016:06:23 16:31:59"}, "2016-06-23T16:31:59"),
        ({"DateTimeOriginal": "2016:06:23 16:31:59.25"}, "2016-06-23T16:31:59"),
        ({"DateTime": "yesterday"}, None),
        ({}, None),
        ({"DateTimeOriginal": "2020:01:01 00:00:00", "DateTime": "2024:05:05 00:00:00"}, "2020-01-01T00:00:00"),
    ],
)
def test_times_are_iso_8601(tags, time):
    assert exif.time(tags) == time


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
