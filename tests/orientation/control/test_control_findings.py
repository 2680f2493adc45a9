"""Findings about control: what is measured of them, and the sentence that each becomes."""

import numpy as np
import pytest
from simulated_block import DRONE, looking, photo_of

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.control_findings import (
    ControlElsewhere,
    ControlExchanged,
    HeightsAllZero,
    HeightsNotTransformed,
    HeightsUnknown,
)
from orthomill.schemas.observations import NO_HEIGHT
from orthomill.schemas.photo import Photos
from orthomill.schemas.project import ANY_CRS, ControlFromFiles, ControlFromGcpList
from orthomill.tasks.geometry.view import View
from orthomill.tasks.orientation.control.control_files import read_control
from orthomill.tasks.orientation.control.control_system import control_from_files, control_from_list
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list

CRS = "EPSG:32634"
PLACE = np.array([500000.0, 4000000.0, 300.0])
PHOTOS = Photos(
    photos=tuple(
        photo_of(View(n, DRONE, looking((0, 0.1, -1)), PLACE), PLACE + np.array([10.0 * i, 0, 0]), 1.0) for i, n in enumerate("ab")
    )
)
HEADER = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\n"
SEEN = "name,photo,col,row,sigma\nP,a,10,20,0.5\nP,b,11,21,0.5\n"


def control(x, y, z=100.0, own=None, crs=CRS):
    return control_from_files(PHOTOS, f"{HEADER}P,control,{float(x)!r},{float(y)!r},{z!r},0.1,0.1,0.2\n", SEEN, own, crs)


@pytest.mark.parametrize(("km", "aside"), [(0.5, False), (2.9, False), (6.9, True), (60.0, True)])
def test_control_is_elsewhere_beyond_three_kilometres_or_ten_times_extent_and_height(km, aside):
    """Extent 10 m and height 300 m: 3.1 km."""
    found = control(PLACE[0] + 1000.0 * km, PLACE[1])
    assert [f.code for f in found.findings] == (["control_elsewhere"] if aside else [])
    assert all("check whether the list is of this site" in f.sentence for f in found.findings), "no other system explains it"
    assert len(found.points) == (0 if aside else 1)


def test_the_distance_is_that_of_the_median_point():
    (finding,) = control(PLACE[0] + 70_005.0, PLACE[1]).findings
    assert finding.distance_m == pytest.approx(70_000.0, abs=1.0) and (finding.points, finding.crs) == (1, CRS)
    assert finding.fits is None and not finding.exchanged


def test_exchanged_coordinates_are_read_as_such_and_said():
    found = control(PLACE[1] + 3.0, PLACE[0] + 1.0)
    assert found.points[0].xyz == (PLACE[0] + 1.0, PLACE[1] + 3.0, 100.0)
    assert found.findings == (ControlExchanged(points=1, crs=CRS),)
    assert "northing (or latitude) of the 1 surveyed points comes first" in found.findings[0].sentence


def test_heights_of_a_system_with_a_vertical_datum_are_reported():
    found = control(PLACE[0], PLACE[1], own="EPSG:32634+5773")
    assert found.findings == (HeightsNotTransformed(crs="EPSG:32634+5773"),) and found.points[0].xyz[2] == 100.0


def control_of(heights, crs=CRS, positions=True, source=None):
    names = "PQR"[: len(heights)]
    place = PLACE if crs != ANY_CRS else np.zeros(3)
    lines = "".join(f"{names[i]},control,{place[0] + i},{place[1]},{z},0.1,0.1,0.2\n" for i, z in enumerate(heights))
    seen = "".join(f"{name},{photo},10,20,0.5\n" for name in names for photo in "ab")
    photos = PHOTOS if positions and crs != ANY_CRS else unplaced()
    return control_from_files(photos, HEADER + lines, "name,photo,col,row,sigma\n" + seen, None, crs, source=source)


def unplaced():
    return Photos(photos=tuple(photo.model_copy(update={"position": None}) for photo in PHOTOS.photos))


@pytest.mark.parametrize(
    ("heights", "crs", "said"),
    [((0, 0, 0), CRS, True), ((0, 0, 0.1), CRS, False), ((0, 0), CRS, False), ((7, 7, 7), CRS, False), ((0, 0, 0), ANY_CRS, False)],
)
def test_heights_that_are_all_0_are_said(heights, crs, said):
    """A local system may have its floor at 0, and two points may well be equally high."""
    found = control_of(heights, crs)
    assert found.findings == ((HeightsAllZero(points=3, freed=True),) if said else ())
    assert [point.sigma[2] for point in found.points] == [NO_HEIGHT if said else 0.2] * len(heights)
    if said:
        assert "the height 0, which was taken as unknown" in found.findings[0].sentence and found.findings[0].grave


def test_heights_that_are_all_0_are_kept_where_nothing_else_holds_the_block():
    found = control_of((0, 0, 0), positions=False)
    assert found.findings == (HeightsAllZero(points=3),) and found.points[0].sigma[2] == 0.2
    assert "All 3 surveyed points have the height 0. Unless" in found.findings[0].sentence


def test_one_height_of_0_among_others_is_none():
    found = control_of((160.2, 0, 171.9))
    assert found.findings == (HeightsUnknown(points=("Q",), zero=True),)
    assert found.points[1].xyz[2] == pytest.approx(166.05) and found.points[1].sigma[2] == NO_HEIGHT
    assert control_of((4.2, 0, -1.9)).findings == (), "near the sea a point may well be at 0"


@pytest.mark.parametrize("number", [-9999.0, 9999.0, -32768.0])
def test_numbers_that_stand_for_no_height_are_none(number):
    found = control_of((160.2, number, 171.9))
    assert found.findings == (HeightsUnknown(points=("Q",), numbers=(number,)),)
    assert found.points[1].xyz[2] == pytest.approx(166.05) and found.points[1].sigma[2] == NO_HEIGHT
    assert f"have the height {number:.0f}, as programs write it where they know none, are used in plan only: Q." in (
        found.findings[0].sentence
    )


@pytest.mark.parametrize("missing", [0, -9999, "nan"])
def test_points_without_a_height_are_named_with_their_lines_and_their_file(missing):
    source = ControlFromFiles(kind="files", points="survey/points.csv", measurements="survey/marks.csv")
    found = control_of((160.2, missing, 171.9), source=source)
    assert found.findings[0].sentence.split(".")[0].endswith("used in plan only: Q (line 3) of survey/points")


def test_points_without_any_height_hold_a_block_without_positions_at_0():
    found = control_of((-9999, -9999, -9999), positions=False)
    assert found.findings == (HeightsUnknown(points=("P", "Q", "R"), numbers=(-9999.0,), alone=True),)
    assert [point.xyz[2] for point in found.points] == [0.0] * 3 and found.points[0].sigma[2] == 0.2
    assert "nothing else holds the block in height" in found.findings[0].sentence and found.findings[0].grave
    beside = control_of((-9999, -9999, -9999))
    assert not beside.findings[0].alone and beside.points[0].sigma[2] == NO_HEIGHT


ELSEWHERE = ControlElsewhere(points=4, crs="EPSG:2100", distance_m=61_400.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, "check whether the list is of this site, and the reference system, the order of the axes and the zone."),
        ({"fits": "EPSG:2100", "exchanged": True}, "they would be there with X and Y exchanged."),
        ({"fits": "EPSG:32635"}, "they would be there in EPSG:32635: state it (control > crs)."),
        (
            {"fits": "EPSG:4326", "exchanged": True},
            "they would be there in EPSG:4326 with latitude before longitude: state it (control > crs).",
        ),
    ],
)
def test_the_sentence_names_distance_and_remedy(change, words):
    text = ELSEWHERE.model_copy(update=change).sentence
    assert text.startswith("The 4 control points, read as EPSG:2100, are 61 km from where the photographs were taken; ")
    assert words in text and text.endswith("took no part in the adjustment.")


LIST = ControlFromGcpList(kind="gcp_list", path="gcp_list.txt", sigma_plan=0.11, sigma_height=0.22, sigma_px=0.33)
LINES = f"{CRS}\n500001 4000001 100 10 20 a P\n500001 4000001 100 11 21 b P\n"


def test_standard_errors_of_a_list_are_those_of_the_workflow():
    (point,) = read_gcp_list(PHOTOS, LINES, LIST).control.points
    assert point.sigma == (0.11, 0.11, 0.22)
    assert point.measurements == {"a": (10, 20, 0.33), "b": (11, 21, 0.33)}


def test_a_list_in_an_unknown_system_is_refused():
    with pytest.raises(WorkflowError, match="'EPSG:1' of the control points is not known"):
        control_from_list(PHOTOS, LINES.replace(CRS, "EPSG:1"), LIST, CRS)


@pytest.mark.parametrize("text", ["EPSG:2100\n", "EPSG:2100\n# 1 2 3 4 5 a P\n"])
def test_a_list_without_points_is_refused(text):
    with pytest.raises(WorkflowError, match="names a reference system, but no point"):
        read_gcp_list(PHOTOS, text, LIST)


def test_a_byte_order_mark_and_comments_are_skipped():
    text = "\ufeff# surveyed in May\n" + HEADER + "# the old church\nP,control,1,2,3,1,1,1\n"
    assert read_control(PHOTOS, text, SEEN).points[0].xyz == (1, 2, 3)


def test_measurements_of_a_scan_follow_into_its_frame():
    """A scan whose frame begins 5 columns and 7 rows into the file."""
    scan = PHOTOS.photos[0].model_copy(update={"scan": (-5.0, 1.0, 0.0, -7.0, 0.0, 1.0), "scan_size": (2010, 1140)})
    photos = Photos(photos=(scan, PHOTOS.photos[1]))
    points = f"{HEADER}P,control,{float(PLACE[0])!r},{float(PLACE[1])!r},100,0.1,0.1,0.2\n"
    found = control_from_files(photos, points, SEEN, None, CRS)
    assert found.points[0].measurements == {"a": (5, 13, 0.5), "b": (11, 21, 0.5)}
