"""Attitudes from tags: analytic directions, both conventions, and the map's north."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Proj

from orthomill.schemas.photo import Photo
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.photos.tags.attitudes import attitude_of, on_map, true_north


def gimbal(yaw, pitch, roll=0.0, maker="drone-dji") -> dict[str, str]:
    return {f"{maker}:Gimbal{name}Degree": f"{value:+.8f}" for name, value in (("Yaw", yaw), ("Pitch", pitch), ("Roll", roll))}


def axes(tags: dict[str, str]) -> np.ndarray:
    """The image axes x, y and against the view as rows, in east, north, up."""
    return rotation_matrix(*np.radians(attitude_of(tags).angles))


@settings(max_examples=60, deadline=None)
@given(yaw=st.floats(-179, 179), pitch=st.floats(-89, -1), roll=st.floats(-40, 40))
def test_the_axis_of_a_gimbal_points_where_yaw_and_pitch_say(yaw, pitch, roll):
    """Heading and inclination of the viewing direction, computed back from the rotation; roll turns the picture about it."""
    rotation = axes(gimbal(yaw, pitch, roll))
    forward = -rotation[2]
    assert np.degrees(np.arcsin(forward[2])) == pytest.approx(pitch, abs=1e-6)
    turn = np.degrees(np.arctan2(forward[0], forward[1])) - yaw
    assert (turn + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-5)
    # Right wing down: the right border of the picture sinks.
    assert rotation[0, 2] == pytest.approx(-np.sin(np.radians(roll)) * np.cos(np.radians(pitch)), abs=1e-9)


def test_simple_attitudes_of_a_gimbal():
    assert attitude_of({}) is None
    down = attitude_of(gimbal(90, -90))
    assert down.of == "gimbal" and down.angles == pytest.approx((0.0, 0.0, -90.0), abs=1e-6), "the top of the frame to the east"
    assert attitude_of(gimbal(0, -30)).angles == pytest.approx((60.0, 0.0, 0.0), abs=1e-6), "looking north and 30 degrees down"


def test_a_gimbal_beyond_the_nadir_is_the_one_that_turned_round():
    """DJI writes what lies 0.1 degrees behind the nadir with yaw and roll turned by 180."""
    assert np.allclose(axes(gimbal(20, -89.9, 180)), axes(gimbal(200, -90.1, 0)), atol=1e-9)


def test_pix4d_counts_from_the_nadir_as_parrot_does():
    body = {"Camera:Yaw": "37.0", "Camera:Pitch": "12.0", "Camera:Roll": "-5.0"}
    assert attitude_of(body).of == "aircraft"
    assert np.allclose(axes({**body, "Camera:Roll": "0"}), axes(gimbal(37, 12 - 90)), atol=1e-9), "nose up looks forward"
    view = -axes({"Camera:Yaw": "0", "Camera:Pitch": "0", "Camera:Roll": "10"})[2]
    assert view == pytest.approx([-np.sin(np.radians(10)), 0, -np.cos(np.radians(10))]), "right wing down looks to the left"


def test_the_roll_of_sensefly_counts_the_other_way():
    words = {"Yaw": "37.0", "Pitch": "12.0", "Roll": "5.0"}
    sensefly, camera = ({f"{prefix}:{name}": value for name, value in words.items()} for prefix in ("sensefly", "Camera"))
    assert np.allclose(axes(sensefly), axes({**camera, "Camera:Roll": "-5.0"}), atol=1e-12)


def test_the_notes_of_earlier_drones_serve_where_there_is_no_xmp():
    note = {"MakerNote:CameraYaw": "44.2", "MakerNote:CameraPitch": "-89.9", "MakerNote:CameraRoll": "0"}
    assert np.allclose(axes(note), axes(gimbal(44.2, -89.9)))
    assert attitude_of(dict.fromkeys(note, "0")) is None, "a note that was never filled in"
    assert attitude_of({**note, **gimbal(10, -45)}).angles == attitude_of(gimbal(10, -45)).angles


@pytest.mark.parametrize("change", [{"drone-dji:GimbalYawDegree": "nan"}, {"drone-dji:GimbalPitchDegree": "1e9"}])
def test_impossible_angles_are_no_attitude(change):
    assert attitude_of({**gimbal(10, -45), **change}) is None


def photo(name: str, longitude: float | None, attitude) -> Photo:
    facts = {"path": f"{name}.jpg", "width": 4, "height": 3, "bands": 3, "dtype": "uint8", "camera": "c"}
    return Photo(name=name, longitude=longitude, latitude=None if longitude is None else 60.0, attitude=attitude, **facts)


def test_north_on_the_map_is_turned_by_the_meridian_convergence():
    place = np.array([[11.9, 60.0], [9.0, 60.0]])
    convergence = Proj("EPSG:32632").get_factors(*place.T).meridian_convergence
    assert true_north("EPSG:32632", place) == pytest.approx(-np.asarray(convergence), abs=1e-6)
    assert abs(true_north("EPSG:32632", place)[0]) > 2.0, "otherwise the test shows nothing"


def test_attitudes_are_those_of_the_map():
    straight = attitude_of(gimbal(0, -90)).angles
    turned, lost, absent = on_map([photo("a", 11.9, straight), photo("b", None, straight), photo("c", 11.9, None)], "EPSG:32632")
    (north,) = true_north("EPSG:32632", np.array([[11.9, 60.0]]))
    # The top of the picture has the azimuth of true north; kappa counts the other way.
    assert turned.attitude == pytest.approx((0, 0, -north), abs=1e-6) and lost.attitude == turned.attitude
    assert absent.attitude is None


def test_a_local_system_has_no_north():
    straight = attitude_of(gimbal(30, -90)).angles
    local = 'ENGCRS["wall",EDATUM["wall"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],LENGTHUNIT["metre",1]]'
    assert on_map([photo("a", 11.9, straight)], local)[0].attitude == straight
    assert on_map([photo("a", 150.0, straight)], "EPSG:32632")[0].attitude == straight, "another part of the world"
