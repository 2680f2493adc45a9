"""Precision, heights, places, instruments and flights by tags: each rule at the tags that it was made for."""

import pytest

from orthomill.schemas.photo import Photo, PhotoRemarkCode
from orthomill.tasks.photos.tags.fixes import fix_of, position_sigma
from orthomill.tasks.photos.tags.flights import with_flights
from orthomill.tasks.photos.tags.heights import height_of, with_one_sign
from orthomill.tasks.photos.tags.instruments import band_of, serial_of, shared_equivalents, with_calibrations, with_serials, zoom_of
from orthomill.tasks.photos.tags.places import place_of


def rtk(flag, *sigma, maker="drone-dji") -> dict[str, str]:
    named = zip(("RtkStdLon", "RtkStdLat", "RtkStdHgt"), sigma, strict=False)
    flagged = {} if flag is None else {f"{maker}:RtkFlag": str(flag)}
    return flagged | {f"{maker}:{name}": f"{value:.5f}" for name, value in named}


def photo(name="a", **facts) -> Photo:
    known = {"path": f"{name}.jpg", "width": 400, "height": 300, "bands": 3, "dtype": "uint8", "camera": "DJI FC 3 mm 400 x 300"}
    return Photo(name=name, **{**known, **facts})


@pytest.mark.parametrize(
    ("flag", "fix"),
    [
        (0, "none"),
        (16, "single"),
        (17, "single"),
        (32, "float"),
        (34, "float"),
        (49, "float"),
        (50, "fixed"),
        (250, None),
        (None, None),
    ],
)
def test_the_flag_says_how_a_position_was_found(flag, fix):
    assert fix_of(rtk(flag)) == fix


@pytest.mark.parametrize(
    ("tags", "sigma"),
    [
        ({}, (3, 3, 5)),
        (rtk(50, 0.01106, 0.01449, 0.0211), (0.01106, 0.01449, 0.0211)),
        (rtk(50, 0.0005, 0.0005, 0.0005), (0.01, 0.01, 0.015)),
        (rtk(50), (0.03, 0.03, 0.05)),
        (rtk(50, 9999.0, 9999.0, 9999.0), (0.03, 0.03, 0.05)),
        (rtk(34, 0.012, 0.013, 0.02), (0.3, 0.3, 0.5)),
        (rtk(34, 0.6, 0.5, 1.2), (0.6, 0.5, 1.2)),
        (rtk(16, 0.012, 0.013, 0.02), (3, 3, 5)),
        (rtk(16, 1.24, 1.20, 3.91), (3, 3, 5)),
        (rtk(16, 4.5, 1.20, 7.0), (4.5, 3, 7)),
        (rtk(0, 0.01, 0.01, 0.02), (3, 3, 5)),
        (rtk(None, 0.01, 0.01, 0.02), (3, 3, 5)),
        ({"Camera:GPSXYAccuracy": "2.301", "Camera:GPSZAccuracy": "3.419"}, (2.301, 2.301, 3.419)),
        ({"sensefly:GPSXYAccuracy": "5.95", "sensefly:GPSZAccuracy": "5.40"}, (5.95, 5.95, 5.4)),
        ({"Camera:GPSXYAccuracy": "0.02", "Camera:GPSZAccuracy": "0.03"}, (0.02, 0.02, 0.03)),
        ({**rtk(16), "Camera:GPSXYAccuracy": "0.02", "Camera:GPSZAccuracy": "0.03"}, (3, 3, 5)),
        ({"GPSHPositioningError": "(6)"}, (6, 6, 10)),
        ({"GPSHPositioningError": "(0)"}, (3, 3, 5)),
    ],
)
def test_what_a_standard_error_in_the_tags_is_worth(tags, sigma):
    assert position_sigma(tags) == pytest.approx(sigma)


def heights(exif=None, absolute=None, relative=None, ref="0", **more) -> dict[str, str]:
    found = {
        "GPSAltitude": exif,
        "drone-dji:AbsoluteAltitude": absolute,
        "drone-dji:RelativeAltitude": relative,
        "GPSAltitudeRef": ref,
    }
    return {name: str(value) for name, value in found.items() if value is not None} | more


@pytest.mark.parametrize(
    ("tags", "value", "kind", "remark"),
    [
        ({}, None, None, None),
        (heights("(100)"), 100, None, None),
        (heights("(198.609)", "+198.61", "+40.10"), 198.609, "barometric", None),
        (heights("(349.542)", "+349.54", "+44.46", **rtk(50)), 349.542, "ellipsoidal", None),
        (heights("(187)", "+187", **{"drone-dji:AltitudeType": "RtkAlt"}), 187, "ellipsoidal", None),
        (heights("(130.575)", None, **{"drone-dji:AltitudeType": "GpsFusionAlt"}), 130.575, "barometric", None),
        (heights("(59.8)", "+59.80", "+59.80"), 59.8, "relative", None),
        (heights("(59.8)", "+2610.2", "+59.80"), 2610.2, "barometric", PhotoRemarkCode.HEIGHT_ABOVE_START),
        (heights("(198.609)", "+198.61", "+60.0", ref="0x01"), 198.609, "barometric", PhotoRemarkCode.BELOW_SEA),
        (heights("(33)", "-33.15", ref="1"), -33, "barometric", None),
        (heights("(120)", "+70", "+40"), 120, "barometric", PhotoRemarkCode.HEIGHTS_DIFFER),
        (heights(None, "+70"), 70, "barometric", None),
        (heights("(50)", ref="2"), 50, "ellipsoidal", None),
        (heights("(50)", "+1e9"), 50, "barometric", None),
    ],
)
def test_which_height_is_used_and_what_it_is(tags, value, kind, remark):
    found = height_of(tags)
    assert (found.value, found.kind, found.remark) == (value, kind, remark)


def test_some_below_the_sea_and_some_above_it_are_all_above():
    block = [photo(str(i), altitude=-198.6 if i < 5 else 198.4 + i / 10) for i in range(8)]
    turned, (remark,) = with_one_sign(block)
    assert [one.altitude for one in turned] == pytest.approx([198.6] * 5 + [198.9, 199.0, 199.1])
    assert remark.code is PhotoRemarkCode.BELOW_SEA and remark.photos == tuple("01234")


def test_heights_about_the_sea_and_far_below_it():
    shore = [photo(str(i), altitude=height) for i, height in enumerate((-6.0, 3.0, 8.0, -2.0))]
    assert with_one_sign(shore) == (shore, [])
    valley = [photo(str(i), altitude=-380.0 - i) for i in range(3)]
    assert with_one_sign(valley)[0] == valley and with_one_sign(valley)[1][0].code is PhotoRemarkCode.ALL_BELOW_SEA
    unknown = [photo("a"), photo("b")]
    assert with_one_sign(unknown) == (unknown, [])


def test_places_of_makers_serve_where_exif_has_none():
    misspelt = {"drone-dji:GpsLatitude": "45.03", "drone-dji:GpsLongtitude": "7.62"}
    assert place_of(misspelt) == (7.62, 45.03) and place_of({}) is None
    assert place_of({**misspelt, "GPSLatitude": "(46)", "GPSLongitude": "(8)"}) == (8.0, 46.0)
    assert place_of({"drone-dji:GpsLatitude": "0.0", "drone-dji:GpsLongitude": "0.0"}) is None


@pytest.mark.parametrize(
    ("tags", "serial"),
    [
        ({}, None),
        ({"BodySerialNumber": "A111", "drone-dji:DroneSerialNumber": "D"}, "A111"),
        ({"BodySerialNumber": "0000", "drone-dji:DroneSerialNumber": "D"}, "D"),
        ({"BodySerialNumber": "None"}, None),
    ],
)
def test_serial_numbers(tags, serial):
    assert serial_of(tags) == serial


@pytest.mark.parametrize(("text", "zoom"), [("(0)", 1), ("(1)", 1), ("(1.5)", 1.5), ("(0.5)", 1), ("(1e9)", 1), ("", 1)])
def test_digital_zoom(text, zoom):
    assert zoom_of({"DigitalZoomRatio": text}) == zoom


@pytest.mark.parametrize(
    ("tags", "band"),
    [
        ({}, None),
        ({"Camera:BandName": "Red"}, "Red"),
        ({"drone-dji:BandName": "NIR", "Camera:CentralWavelength": "840"}, "NIR"),
        ({"Camera:CentralWavelength": "840"}, "840 nm"),
        ({"Camera:BandName": "Red,Green,Blue"}, None),
        ({"drone-dji:BandName": "RGB"}, None),
    ],
)
def test_spectral_bands(tags, band):
    assert band_of(tags) == band


def test_two_bodies_of_one_model_are_two_cameras():
    one = [photo("a", serial="A-111"), photo("b", serial="A-111"), photo("c")]
    assert with_serials(one) == one, "a single serial number changes no name"
    names = [named.camera for named in with_serials([*one, photo("d", serial="B/222")])]
    assert names == ["DJI FC 3 mm no. A-111 400 x 300"] * 2 + ["DJI FC 3 mm 400 x 300", "DJI FC 3 mm no. B222 400 x 300"]


def test_two_calibrations_of_one_name_are_two_cameras():
    cameras = [{"kind": "calibrated", "c": c} for c in (500.0, 510.0, 500.0)]
    block = [photo(str(i), factory=camera) for i, camera in enumerate(cameras)]
    names = [one.camera for one in with_calibrations(block)]
    assert names[0] == names[2] == "DJI FC 3 mm calibration 1 400 x 300" and names[1] == "DJI FC 3 mm calibration 2 400 x 300"
    assert with_calibrations(block[::2]) == block[::2]


def test_an_equivalent_that_does_not_follow_the_zoom_is_multiplied():
    drone = [photo("a", focal_35mm=20.0), photo("b", focal_35mm=20.0, zoom=1.5)]
    assert [one.focal_35mm for one in shared_equivalents(drone)] == [20.0, 30.0]
    phone = [photo("a", focal_35mm=28.0), photo("b", focal_35mm=56.0, zoom=2.0)]
    assert [one.focal_35mm for one in shared_equivalents(phone)] == [28.0, 56.0]


def flown(*minutes: float, **facts) -> list[Photo]:
    times = (f"2024-05-01T{9 + int(m // 60):02d}:{int(m % 60):02d}:{round(m * 60) % 60:02d}" for m in minutes)
    return [photo(str(m), time=time, **facts) for m, time in zip(minutes, times, strict=True)]


def numbers(photos: list[Photo]) -> list[int]:
    return [one.flight for one in with_flights(photos)]


def test_a_long_break_is_between_two_flights():
    assert numbers(flown(0, 0.05, 0.1, 0.15)) == [0, 0, 0, 0]
    assert numbers(flown(0, 0.05, 0.1, 25, 25.05, 60)) == [0, 0, 0, 1, 1, 2]
    assert numbers(flown(0, 0.05, 0.1, 5, 5.05)) == [0, 0, 0, 0, 0], "a pause of one flight"
    assert numbers(flown(0, 30, 60, 90)) == [0, 0, 0, 0], "half an hour is their interval"
    assert numbers(flown(25, 0.05, 0.1, 0)) == [1, 0, 0, 0], "in the order of time"


def test_another_take_off_is_another_flight():
    first = flown(0, 0.05, 0.1, altitude=300.0, relative_height=60.0, height_kind="barometric")
    second = flown(4, 4.05, altitude=300.0, relative_height=63.0, height_kind="barometric")
    assert numbers(first + second) == [0, 0, 0, 1, 1]
    rtk_heights = [one.model_copy(update={"height_kind": "ellipsoidal"}) for one in first + second]
    assert numbers(rtk_heights) == [0] * 5, "the two heights are of two instruments and drift apart"


def test_receivers_have_flights_of_their_own():
    block = flown(0, 0.05, serial="A") + flown(0, 0.05, serial="B") + [photo("x", serial="A"), photo("y")]
    assert numbers(block) == [0, 0, 1, 1, 0, 2]
