"""How far an aircraft moves while the rows of a photograph are exposed."""

import pytest

from orthomill.schemas.photo import Photo
from orthomill.tasks.photos.rolling_shutter import displacement_px, readout_s, rolling_shutter_sentences, stated_speed


def photo(number: int, **changes) -> Photo:
    """One of a strip flown at 10 m/s, 100 m above the ground, with a constant of 2500 px: a pixel is 4 cm."""
    facts = {
        "name": f"p{number}",
        "path": f"p{number}.jpg",
        "width": 4000,
        "height": 3000,
        "bands": 3,
        "dtype": "uint8",
        "camera": "DJI FC300S",
        "focal_35mm": 2500.0 * 43.27 / 5000.0,
        "relative_height": 100.0,
        "readout_s": 0.033,
        "time": f"2026-05-01T10:00:{4 * number:02d}",
        "position": (500_000.0 + 40.0 * number, 4_000_000.0, 300.0),
    }
    return Photo(**{**facts, **changes})


def test_speed_times_readout_over_the_ground_pixel():
    strip = [photo(number) for number in range(6)]
    assert displacement_px(strip) == pytest.approx(10.0 * 0.033 / 0.04, rel=1e-3)
    (sentence,) = rolling_shutter_sentences(strip)
    assert "(33 ms)" in sentence and "about 8.2 pixels" in sentence and "'variation'" in sentence


def test_exposures_within_a_second_need_its_fraction():
    quick = {"position": None, "time": None}
    at = [{"position": (500_000.0 + 7.0 * k, 4_000_000.0, 300.0)} for k in range(6)]
    timed = [{"time": f"2026-05-01T10:00:0{7 * k // 10}.{7 * k % 10}00"} for k in range(6)]
    assert displacement_px([photo(k, **(quick | at[k] | timed[k])) for k in range(6)]) == pytest.approx(8.25, rel=1e-3)
    whole = [{"time": one["time"].partition(".")[0]} for one in timed]
    assert displacement_px([photo(k, **(quick | at[k] | whole[k])) for k in range(6)]) is None


def test_the_speed_of_the_tags_comes_first():
    assert displacement_px([photo(number, speed=1.0) for number in range(4)]) == pytest.approx(0.825, rel=1e-3)
    assert not list(rolling_shutter_sentences([photo(number, speed=1.0) for number in range(4)]))


@pytest.mark.parametrize("unknown", [{"readout_s": None}, {"relative_height": None}, {"time": None}, {"focal_35mm": None}])
def test_nothing_is_said_of_what_is_not_known(unknown):
    assert displacement_px([photo(number, **unknown) for number in range(4)]) is None


def test_tags():
    assert readout_s({"Model": "FC220"}, 3000) == pytest.approx(0.064) and readout_s({"Model": "FC6360"}, 1300) is None
    assert readout_s({"Camera:LineReadoutTime": "47500"}, 3456) == pytest.approx(0.16416)
    assert stated_speed({"drone-dji:FlightXSpeed": "+3.0", "drone-dji:FlightYSpeed": "-4.0"}) == pytest.approx(5.0)
    assert stated_speed({"drone-dji:FlightXSpeed": "+3.0"}) is None
