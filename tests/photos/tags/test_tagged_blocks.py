"""Blocks by their tags as a project has them: positions, cameras and what is said, of real files and of small made ones."""

from pathlib import Path

import numpy as np
import pytest

from orthomill.pipeline.storage.image_files import read_header
from orthomill.schemas.errors import PhotoError
from orthomill.schemas.findings.flight_findings import PositionsBeside
from orthomill.schemas.photo import Header, PhotoRemarkCode, Photos
from orthomill.schemas.project import PositionsFromExif
from orthomill.tasks.calibration.cameras.untagged_photographs import cameras_from_exif
from orthomill.tasks.photos.index import Limits, index_photos
from orthomill.tasks.photos.report.first_look import first_look
from orthomill.tasks.photos.report.photos_report import header_warnings, remark_sentence
from orthomill.tasks.photos.tags.places import places_apart

SHARED = Path(__file__).parents[4] / "shared"
YARD = SHARED / "data" / "rtk_yard"
BY_TAGS = PositionsFromExif(kind="exif")


def header(name: str, east: float = 0.0, **tags: str) -> Header:
    known = {
        "Make": "DJI",
        "Model": "FC9999",
        "FocalLength": "(8.8)",
        "FocalLengthIn35mmFilm": "24",
        "GPSLatitude": "(45) (0) (0)",
        "GPSLatitudeRef": "N",
        "GPSLongitude": f"(9) (0) ({east})",
        "GPSLongitudeRef": "E",
        "GPSAltitude": "(200)",
    }
    return Header(path=f"photos/{name}.jpg", width=4000, height=3000, bands=3, dtype="uint8", tags=known | tags)


def block(*headers: Header, **settings) -> Photos:
    positions = BY_TAGS.model_copy(update=settings)
    return index_photos(headers, "EPSG:32632", positions, Limits(megapixels=50)).photos


def dji(**tags: str) -> dict[str, str]:
    return {f"drone-dji:{name}": value for name, value in tags.items()}


RTK = {"RtkStdLon": "0.011", "RtkStdLat": "0.012", "RtkStdHgt": "0.023"}


def said(photos: Photos, code: PhotoRemarkCode) -> str:
    (remark,) = (remark for remark in photos.remarks if remark.code is code)
    return remark_sentence(remark)


@pytest.mark.parametrize(("flags", "all_of_them"), [(("50", "50", "34"), True), (("50", "50", "16"), False)])
def test_a_first_look_tells_whether_all_heights_are_above_the_ellipsoid(flags, all_of_them):
    headers = tuple(header(str(i), i, **dji(RtkFlag=flag, **RTK)) for i, flag in enumerate(flags))
    assert first_look(headers, "EPSG:32632").ellipsoidal is all_of_them


def test_each_photograph_has_the_precision_of_its_fix():
    headers = [header(str(i), i, **dji(RtkFlag=flag, **RTK)) for i, flag in enumerate(("50", "50", "34", "16"))]
    photos = block(*headers)
    assert [photo.position_sigma for photo in photos.photos] == [(0.011, 0.012, 0.023)] * 2 + [(0.3, 0.3, 0.5), (3.0, 3.0, 5.0)]
    assert [photo.fix for photo in photos.photos] == ["fixed", "fixed", "float", "single"]
    assert [photo.height_kind for photo in photos.photos] == ["ellipsoidal"] * 3 + [None]
    assert "2 fixed, 1 float, 1 without corrections" in said(photos, PhotoRemarkCode.OWN_PRECISION)


def test_stated_standard_errors_hold_for_all():
    headers = [header(str(i), i, **dji(RtkFlag="50", **RTK)) for i in range(3)]
    assert {photo.position_sigma for photo in block(*headers, sigma_plan=0.5, sigma_height=0.9).photos} == {(0.5, 0.5, 0.9)}
    assert {photo.position_sigma for photo in block(*headers, sigma_height=0.9).photos} == {(0.011, 0.012, 0.9)}


def test_nothing_is_said_of_an_ordinary_receiver():
    assert block(*(header(str(i), i, **dji(RtkFlag="0", GimbalYawDegree="10")) for i in range(3))).remarks == ()


def test_remarks_are_one_of_a_kind():
    tags = dji(AbsoluteAltitude="+200.0", RelativeAltitude="+40.0", DewarpFlag="1")
    photos = block(*(header(str(i), i, GPSAltitudeRef="1", **tags) for i in range(12)))
    assert [photo.altitude for photo in photos.photos] == [200.0] * 12
    assert [remark.code for remark in photos.remarks] == [PhotoRemarkCode.BELOW_SEA, PhotoRemarkCode.DEWARPED]
    assert "12 photographs" in said(photos, PhotoRemarkCode.BELOW_SEA)


def test_relative_heights_are_said():
    photos = block(*(header(str(i), i, **dji(AbsoluteAltitude="+200.0", RelativeAltitude="+200.0")) for i in range(3)))
    assert {photo.height_kind for photo in photos.photos} == {"relative"}
    assert "above the place of take-off" in said(photos, PhotoRemarkCode.RELATIVE_HEIGHTS)


def test_zoom_and_serial_numbers_make_cameras():
    photos = block(header("a", DigitalZoomRatio="(1.5)"), header("b", 1.0), header("c", 2.0))
    assert [photo.camera for photo in photos.photos] == ["DJI FC9999 8.8 mm zoom 1.5 4000 x 3000"] + [
        "DJI FC9999 8.8 mm 4000 x 3000"
    ] * 2
    _, cameras, _ = cameras_from_exif(photos)
    zoomed, plain = (cameras[photos[name].camera].c for name in "ab")
    assert zoomed == pytest.approx(1.5 * plain) and "1.5 times" in said(photos, PhotoRemarkCode.DIGITAL_ZOOM)
    two = block(header("a", BodySerialNumber="A1"), header("b", 1.0, BodySerialNumber="B2"))
    assert len({photo.camera for photo in two.photos}) == 2 and "no. A1" in said(two, PhotoRemarkCode.SEVERAL_SERIALS)
    assert [photo.flight for photo in two.photos] == [0, 1]


def test_bands_are_cameras_of_their_own():
    photos = block(header("a", **{"Camera:BandName": "Red"}), header("b", 1.0))
    assert [photo.band for photo in photos.photos] == ["Red", None] and photos["a"].camera == "DJI FC9999 8.8 mm Red 4000 x 3000"


@pytest.mark.skipif(not YARD.exists(), reason="the photographs of rtk_yard lie beside the repository")
def test_the_yard_has_positions_angles_and_a_camera_by_its_tags():
    headers = tuple(read_header(path) for path in sorted(YARD.glob("*.JPG")))
    photos = block(*headers)
    sigma = np.array([photo.position_sigma for photo in photos.photos])
    assert len(sigma) == 20 and (sigma < 0.03).all() and (sigma >= 0.01).all()
    assert {photo.fix for photo in photos.photos} == {"fixed"} and {photo.flight for photo in photos.photos} == {0}
    assert max(abs(angle) for photo in photos.photos for angle in photo.attitude[:2]) < 0.2, "the gimbal looked down"
    _, cameras, untagged = cameras_from_exif(photos)
    (camera,) = cameras.values()
    assert not untagged and camera.c == pytest.approx(1955.65, abs=0.01) and camera.lens.k1 == pytest.approx(-0.42275)


CASES = SHARED / "cases"


@pytest.mark.skipif(not CASES.exists(), reason="the inputs that failed lie beside the repository")
def test_inputs_that_failed():
    def case(name: str) -> Photos:
        files = sorted(path for path in (CASES / name / "site").iterdir() if path.suffix.lower() in {".jpg", ".tif", ".png"})
        return index_photos(tuple(map(read_header, files)), "EPSG:32615", BY_TAGS, Limits(megapixels=50)).photos

    assert min(photo.position[2] for photo in case("altitude_ref_all_below").photos) == pytest.approx(198.5, abs=0.1)
    assert {photo.position_sigma for photo in case("rtk_tags").photos} == {(0.01134, 0.01201, 0.0231)}
    tiff = case("tiff_tags").photos[0]
    assert (tiff.width, tiff.height, tiff.exif_orientation, tiff.camera) == (240, 136, 6, "DJI FC300S 3.6 mm 136 x 240")
    assert tiff.pixel_um is not None and case("png_exif").photos[0].position is not None
    assert case("png_exif").photos[0].focal_mm == 3.61
    for name in ("two_serial_numbers", "digital_zoom_half"):
        assert len({photo.camera for photo in case(name).photos}) == 2
    # Bands are set aside by their tags, and no colour photograph as their copy.
    assert [photo.band for photo in case("rgb_and_bands").photos] == [None] * 4


def test_the_first_look_says_nothing_twice():
    headers = [header(name, i, BodySerialNumber=name, **dji(RtkFlag="50", **RTK)) for i, name in enumerate(("A1", "B2"))]
    lines = first_look(tuple(headers), "EPSG:32632").lines
    assert sum("fixed" in line for line in lines) == 1 and sum(line.startswith("Camera") for line in lines) == 2
    assert lines[0].startswith(
        "Cameras: DJI FC9999 8.8 mm no. A1 4000 x 3000 (1), DJI FC9999 8.8 mm no. B2 4000 x 3000 (1); no factory"
    )
    (told,) = (line for line in header_warnings(block(*headers), "exif", "exif") if "cameras" in line.lower())
    assert told.startswith("Cameras of one model have different serial numbers")


def test_a_first_look_tells_of_the_positions_of_a_file():
    headers = tuple(header(f"DJI_{n}", float(n)) for n in range(3))
    rows = "".join(f"DJI_{n},{500000 + 20 * n},4983000,250,0.02,0.02,0.04\n" for n in range(3))
    text = "photo,x,y,z,sigma_x,sigma_y,sigma_z\n" + rows
    told = " ".join(first_look(headers, "EPSG:32632", PositionsBeside(path="rtk.csv", text=text)).findings)
    assert (
        "in rtk.csv, of 3 of 3; standard errors 0.02 m in plan, 0.04 m in height." in told and "Positions: in the tags" not in told
    )
    assumed = "photo,x,y,z\n" + "".join(",".join(row.split(",")[:4]) + "\n" for row in rows.splitlines())
    told = " ".join(first_look(headers, "EPSG:32632", PositionsBeside(path="rtk.csv", text=assumed)).findings)
    assert "3 m in plan, 5 m in height (assumed, for the file states none)" in told
    # What the run refuses, it refuses itself.
    told = " ".join(first_look(headers, "EPSG:32632", PositionsBeside(path="rtk.csv", text="nothing")).findings)
    assert "in the tags of 3 of 3" in told


def test_a_fixed_solution_with_the_standard_errors_of_none_is_told():
    """RtkStd in millimetres, as some converters write them."""
    photos = block(*(header(str(i), i, **dji(RtkFlag="50", RtkStdLon="11", RtkStdLat="12", RtkStdHgt="23")) for i in range(3)))
    assert "standard errors of 11 m and 23 m, which contradict each other" in said(photos, PhotoRemarkCode.FIX_CONTRADICTED)
    stated = block(*(header(str(i), i, **dji(RtkFlag="50", **RTK)) for i in range(3)))
    assert PhotoRemarkCode.FIX_CONTRADICTED not in {remark.code for remark in stated.remarks}


def test_exchanged_latitude_and_longitude_in_the_tags_are_told():
    exchanged = header("0", GPSLatitude="(120) (0) (0)", GPSLongitude="(45) (0) (0)")
    photos = block(exchanged, *(header(str(i), i) for i in range(1, 4)))
    sentence = said(photos, PhotoRemarkCode.PLACE_IMPOSSIBLE)
    assert "1 photograph (0) hold degrees that are nowhere on the Earth, with latitude and longitude exchanged" in sentence


def test_a_receiver_that_repeats_its_last_position_is_told():
    photos = block(*(header(str(i), min(i, 4)) for i in range(8)))
    assert "4 photographs (4, 5, 6, 7) were taken at one and the same place" in said(photos, PhotoRemarkCode.SAME_PLACE)
    assert "Together they weigh as one position" in said(photos, PhotoRemarkCode.SAME_PLACE)


def test_photographs_of_one_place_weigh_as_one_position():
    photos = block(*(header(str(i), min(i, 4)) for i in range(8))).photos
    alone, repeated = photos[0].position_sigma, [photo.position_sigma for photo in photos[4:]]
    assert photos[3].position_sigma == alone
    weights = np.sum(1.0 / np.square(repeated), axis=0)
    np.testing.assert_allclose(weights, 1.0 / np.square(alone))
    twice = block(*(header(str(i), i // 2) for i in range(6))).photos
    assert {photo.position_sigma for photo in twice} == {alone}


def test_heights_of_two_surfaces_in_one_flight_are_told():
    kinds = ("RtkAlt", "RtkAlt", "PressureAlt")
    photos = block(*(header(str(i), i, **dji(AltitudeType=kind)) for i, kind in enumerate(kinds)))
    assert "(2 above the ellipsoid, 1 barometric)" in said(photos, PhotoRemarkCode.HEIGHT_KINDS_MIXED)


def test_a_calibration_that_contradicts_the_focal_length_is_told_and_not_used():
    dewarp = dji(DewarpData="2020-01-01;1000,1000,0,0,-0.1,0,0,0,0")
    photos = block(*(header(str(i), i, **dewarp) for i in range(3)))
    sentence = said(photos, PhotoRemarkCode.FACTORY_CONTRADICTED)
    assert "contradicts their focal length (1000 and 2773 px): the focal length is used" in sentence
    assert photos["0"].factory is None
    assert PhotoRemarkCode.FACTORY_CAMERA not in {remark.code for remark in photos.remarks}


def test_halves_on_two_sides_of_the_earth_are_refused_with_both_places():
    other = [header(str(i), i, GPSLongitudeRef="W") for i in range(2, 4)]
    with pytest.raises(PhotoError, match=r"0, 1 at longitude 9.00, latitude 45.00, and 2, 3 at longitude -9.00"):
        block(header("0"), header("1", 1), *other)
    with pytest.raises(PhotoError, match="East and west"):
        first_look((header("0"), header("1", 1), *other), "EPSG:32632")


def test_places_of_two_tags_that_are_not_one_are_told():
    photos = block(*(header(str(i), i, **dji(GpsLatitude="45.01", GpsLongitude=str(9 + i / 3600))) for i in range(3)))
    assert "different places of 3 photographs (0, 1, 2), up to 1112 m apart" in said(photos, PhotoRemarkCode.PLACES_DIFFER)


def test_places_on_two_sides_of_the_date_line_are_near():
    tags = header("0", GPSLongitude="(179) (59) (59.964)", **dji(GpsLatitude="45", GpsLongitude="-179.99999")).tags
    assert places_apart(tags) == pytest.approx(1.57, abs=0.01)


@pytest.mark.parametrize(("datum", "told"), [("TOKYO", True), ("NAD27", True), ("WGS-84", False), ("WGS 84", False), ("", False)])
def test_a_datum_of_maps_in_the_tags_is_told(datum, told):
    photos = block(*(header(str(i), i, GPSMapDatum=datum) for i in range(3)))
    codes = {remark.code for remark in photos.remarks}
    assert (PhotoRemarkCode.MAP_DATUM in codes) is told
    assert not told or f"name the datum {datum}," in said(photos, PhotoRemarkCode.MAP_DATUM)


def test_equivalents_that_differ_at_one_focal_length_are_told():
    photos = block(*(header(str(i), i, FocalLengthIn35mmFilm="48" if i == 3 else "24") for i in range(4)))
    assert "differ (24, 48 mm; not as most: 1 photograph, 3)" in said(photos, PhotoRemarkCode.EQUIVALENTS_DIFFER)
