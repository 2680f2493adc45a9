"""The report on the photographs: figures, grids, and each warning where its fact is present and only there."""

import pytest

from orthomill.schemas.photo import Photo, PhotoRemark, PhotoRemarkCode, Photos
from orthomill.tasks.photos.pixels import Exposure
from orthomill.tasks.photos.report.photos_report import photos_report
from orthomill.tasks.photos.scans import Scan, Scans


def photo(name: str, **changes) -> Photo:
    facts = {"path": f"in/{name}.jpg", "width": 4000, "height": 3000, "bands": 3, "dtype": "uint8", "camera": "c", "focal_mm": 8.8}
    return Photo(name=name, **{**facts, **changes})


def exposure(name: str, **changes) -> Exposure:
    return Exposure(**{"photo": name, "mean": 0.5, "contrast": 0.2, "black": 0.0, "white": 0.0, **changes})


def report_of(*photos: Photo, exposures=None, scans=None, remarks=(), positions="exif", cameras="exif"):
    shown = exposures or tuple(exposure(one.name) for one in photos)
    return photos_report(Photos(photos=photos, remarks=remarks), scans or Scans(), shown, positions, cameras)


PLACED = tuple(photo(name, position=(east, 0.0, 100.0)) for name, east in (("a", 0.0), ("b", 30.0), ("c", 100.0)))


def test_figures_of_a_faultless_project_and_no_warning():
    report = report_of(*PLACED)
    values = {figure.name: figure.value for figure in report.figures}
    assert values == {"photographs": 3, "megapixels": 36.0, "cameras": 1, "with_position": 3, "nearest_distance": 30.0}
    assert report.warnings == ()
    assert [grid.title for grid in report.grids] == ["Photographs", "Cameras"]


def test_the_map_shows_photographs_with_a_position_only():
    (chart,) = report_of(*PLACED, photo("d")).charts
    assert chart.labels == ("a", "b", "c") and chart.x == (0.0, 30.0, 100.0)
    assert report_of(photo("d")).charts == ()


def test_pictures_are_spread_over_many_photographs():
    report = report_of(*(photo(f"p{number}", levels=4) for number in range(20)))
    assert [picture.raster for picture in report.pictures] == [f"photos/p{number}/3" for number in range(0, 18, 3)]


@pytest.mark.parametrize(
    ("positions", "sentence"),
    [("exif", "no GPS tags with longitude, latitude and altitude"), ("file", "no line in the positions file"), ("none", None)],
)
def test_missing_positions_are_reported_where_some_were_expected(positions, sentence):
    warnings = report_of(*PLACED, photo("d"), positions=positions).warnings
    assert warnings == (() if sentence is None else (f"1 photograph (d) without a position: {sentence}.",))


@pytest.mark.parametrize(("cameras", "count"), [("exif", 1), ("given", 0)])
def test_a_missing_focal_length_matters_to_cameras_from_exif(cameras, count):
    warnings = report_of(*PLACED, photo("d", position=(0.0, 9.0, 0.0), focal_mm=None), cameras=cameras).warnings
    assert len(warnings) == count and all("1 photograph (d) without a focal length" in text for text in warnings)


def test_a_35_mm_equivalent_is_a_focal_length():
    assert report_of(*PLACED, photo("d", position=(0.0, 9.0, 0.0), focal_mm=None, focal_35mm=24.0)).warnings == ()


def test_several_cameras_and_mixed_bands_are_reported():
    first, second = report_of(*PLACED, photo("d", position=(0.0, 9.0, 0.0), camera="other", bands=1)).warnings
    assert first.startswith("The photographs come from 2 cameras") and second.startswith("Grey and colour photographs are mixed")


def test_sixteen_bits_of_the_photographs_are_said_to_reach_the_orthoimage():
    (warning,) = report_of(*(one.model_copy(update={"dtype": "uint16"}) for one in PLACED)).warnings
    assert f"{len(PLACED)} photographs" in warning and "the orthoimage has 16" in warning


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"masked": 0.95, "contrast": 0.0}, "hardly anything that is not transparent"),
        ({"white": 0.11}, "fully white"),
        ({"black": 0.11}, "fully black"),
        ({"contrast": 0.02}, "very little contrast"),
    ],
)
def test_bad_exposures_are_named(change, words):
    exposures = (exposure("a"), exposure("b", **change), exposure("c"))
    (warning,) = report_of(*PLACED, exposures=exposures).warnings
    assert warning.startswith("1 photograph (b)") and words in warning


def test_every_remark_becomes_one_warning():
    remarks = tuple(
        PhotoRemark(code=code, photos=("x/a.jpg", "y/a.png"), distance_km=77.4, words=("Red", "Green")) for code in PhotoRemarkCode
    )
    warnings = report_of(*PLACED, remarks=remarks).warnings
    assert len(warnings) == len(set(warnings)) == len(PhotoRemarkCode)
    duplicate, stray, unusable, broken, damaged, no_altitude, absent, apart, bands, thermal, panorama, rotated = warnings[:12]
    assert bands.startswith("2 files of other bands set aside (Red; x/a.jpg, y/a.png): the block is made of the band Green.")
    assert "colours of their pictures are used" in thermal and panorama.startswith("2 files set aside: x/a.jpg, y/a.png, panoramas")
    assert absent.endswith("which are skipped: x/a.jpg, y/a.png.") and "lie 77 km or more from all others" in apart
    assert duplicate.startswith("x/a.jpg and y/a.png have the same name a,") and "rename" in duplicate
    assert unusable == "2 files set aside: x/a.jpg Red, y/a.png Green."
    assert "lie 77 km or more from the others" in stray and rotated.startswith("x/a.jpg, y/a.png: ")
    assert broken == "2 files set aside: x/a.jpg is Red, y/a.png is Green. Copy them again from the camera."
    assert "EXIF tags are damaged" in damaged and "no possible altitude" in no_altitude


def scan(name: str, **changes) -> Scan:
    facts = {"photo": name, "marks": 8, "rms_um": 5.0, "sigma_um": (2.0, 4.0), "turn_deg": 0.1, "col_um": 15.0, "row_um": 15.0}
    return Scan(**{**facts, **changes})


@pytest.mark.parametrize(
    ("change", "cut", "words"),
    [
        ({}, True, None),
        ({}, False, "give picture_mm"),
        ({"rms_um": 31.0}, True, "a (31) fit an affine transformation worse"),
        ({"rms_um": 29.0}, True, None),
        ({"mirrored": True}, True, "1 photograph (a) mirrored"),
        ({"wrong": {"3": 12.34}}, True, "The fiducial mark 3 of a lies 12.3 px"),
        ({"rms_um": None, "sigma_um": None}, True, None),
    ],
)
def test_scans_are_warned_of_where_marks_disagree(change, cut, words):
    report = report_of(*PLACED, scans=Scans(scans=(scan("a", **change),), cut=cut))
    assert [words in text for text in report.warnings] == ([] if words is None else [True])
    (grid,) = (grid for grid in report.grids if grid.title == "Scans")
    assert len(grid.rows[0]) == len(grid.columns) == 8


def test_principal_pixels_have_no_marks_to_warn_of():
    shifted = scan("a", marks=0, rms_um=None, sigma_um=None, col_um=None, row_um=None)
    assert report_of(*PLACED, scans=Scans(scans=(shifted,))).warnings == ()
