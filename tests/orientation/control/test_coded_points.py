"""Coded targets as control: found in parts of photographs, named, placed by a list, and as ends of scale bars."""

import cv2
import numpy as np
import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.control_findings import TargetsNotFound, TargetsTwice
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromTargets
from orthomill.tasks.orientation.control import coded_points
from orthomill.tasks.orientation.control.coded_points import FoundCode, PhotoCodes, codes_in_photograph, search_windows
from orthomill.tasks.orientation.control.control_system import control_from_targets

SHAPE = (700, 900)
NAMES = ("a", "b", "c")
CRS = "EPSG:32632"


def drawn(places, side=80):
    """A grey photograph with AprilTags: number -> centre (col, row)."""
    pixels = np.full((*SHAPE, 1), 150, np.uint8)
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for number, (col, row) in places:
        tag = np.pad(cv2.aruco.generateImageMarker(family, number, side), side // 8, constant_values=255)
        top, left = row - tag.shape[0] // 2, col - tag.shape[1] // 2
        pixels[top : top + tag.shape[0], left : left + tag.shape[1], 0] = tag
    return cv2.GaussianBlur(pixels, (0, 0), 1.0)[..., None]


def searched(pixels, monkeypatch, side=400, halo=160):
    monkeypatch.setattr(coded_points, "SIDE", side)
    monkeypatch.setattr(coded_points, "HALO", halo)
    windows = search_windows(*SHAPE)
    assert len(windows) > 4
    return codes_in_photograph((pixels[window.slices] for window in windows), "a", windows)


def test_codes_are_found_wherever_the_parts_end(monkeypatch):
    places = [(0, (100, 120)), (3, (400, 330)), (7, (640, 395)), (9, (820, 620))]
    found = searched(drawn(places), monkeypatch)
    assert [code.name for code in found.codes] == [f"tag36h11-{number}" for number, _ in places]
    for code, (_, (col, row)) in zip(found.codes, places, strict=True):
        # Drawn between pixels: an even side has its centre half a pixel before the middle one.
        assert (code.col, code.row) == pytest.approx((col - 0.5, row - 0.5), abs=3 * code.sigma)


def test_a_code_that_shows_twice_is_no_point(monkeypatch):
    found = searched(drawn([(5, (100, 120)), (5, (800, 600)), (6, (400, 300))]), monkeypatch)
    assert [code.name for code in found.codes] == ["tag36h11-6"] and found.twice == ("tag36h11-5",)


def photos(**fields):
    return Photos(
        photos=tuple(
            Photo(name=n, path=f"{n}.jpg", width=900, height=700, bands=1, dtype="uint8", camera="k", **fields) for n in NAMES
        )
    )


def codes(*numbers, names=NAMES):
    """The same codes in several photographs."""
    return tuple(
        PhotoCodes(
            photo=name, codes=tuple(FoundCode(name=f"tag36h11-{k}", col=10.0 * k, row=20.0 + i, sigma=0.17) for k in numbers)
        )
        for i, name in enumerate(names)
    )


def read(found, points=None, distances=None, **fields):
    source = ControlFromTargets(kind="targets", points="points.csv" if points else None, **fields)
    return control_from_targets(photos(), found, source, CRS, points, distances)


def test_points_are_named_by_codes_or_their_numbers_and_others_are_tie_points():
    control = read(
        codes(1, 2, 7), "name,x,y,z\n1,500000,5000000,300\nTAG36H11-2,500010,5000000,301\n9,500020,5000000,300\n", check=("1",)
    )
    roles = {point.name: point.role for point in control.points}
    assert roles == {"1": "check", "TAG36H11-2": "control", "tag36h11-7": "tie"}
    assert control.points[0].sigma == (0.03, 0.03, 0.05) and control.points[1].xyz == (500010.0, 5000000.0, 301.0)
    assert control.points[0].measurements == {"a": (10.0, 20.0, 0.17), "b": (10.0, 21.0, 0.17), "c": (10.0, 22.0, 0.17)}
    assert TargetsNotFound(points=("9",)) in control.findings


def test_a_code_on_two_plates_is_named():
    doubled = tuple(one.model_copy(update={"twice": ("tag36h11-1",) if one.photo == "a" else ()}) for one in codes(2))
    control = read(doubled, "name,x,y,z\n2,500000,5000000,300\n")
    assert control.findings == (TargetsTwice(codes=("tag36h11-1",), photos=("a",)),)


def test_scale_bars_need_no_coordinates():
    control = read(codes(1, 2), None, "from,to,metres,sigma\ntag36h11-1,tag36h11-2,1.5,0.0001\n")
    assert [point.role for point in control.points] == ["tie", "tie"]
    (bar,) = control.distances
    assert (bar.first, bar.second, bar.length, bar.sigma) == ("tag36h11-1", "tag36h11-2", 1.5, 0.0001)


def test_what_was_not_found_is_refused_with_what_was():
    with pytest.raises(WorkflowError, match=r"points.csv \(P1\); found: tag36h11-1, tag36h11-2"):
        read(codes(1, 2), "name,x,y,z\nP1,500000,5000000,300\n")
    with pytest.raises(WorkflowError, match="none at all"):
        read(codes(), "name,x,y,z\nP1,500000,5000000,300\n")
    with pytest.raises(WorkflowError, match=r"line 2.*'tag36h11-8' was found in no two photographs"):
        read(codes(1), None, "from,to,metres,sigma\ntag36h11-1,tag36h11-8,1.5,0.0001\n")


def test_a_number_of_two_families_names_neither():
    both = codes(4)[0]
    both = both.model_copy(update={"codes": (*both.codes, FoundCode(name="aruco4x4-4", col=5.0, row=5.0, sigma=0.17))})
    with pytest.raises(WorkflowError, match="Name the points like the codes"):
        read((both,), "name,x,y,z\n4,500000,5000000,300\n")
    control = read((both,), "name,x,y,z\naruco4x4-4,500000,5000000,300\n")
    assert [point.name for point in control.points] == ["aruco4x4-4"]


def test_marks_in_scans_are_those_of_their_frame():
    scan = (3.0, 1.0, 0.01, -2.0, -0.01, 1.0)
    source = ControlFromTargets(kind="targets", sigma_plan=0.01, sigma_height=0.02, errors_in="m", crs=CRS)
    control = control_from_targets(photos(scan=scan), codes(1), source, CRS)
    assert control.points[0].measurements["b"] == pytest.approx((10.0, 21.0, 0.17), abs=1e-9)
