"""Control files that name photographs which the project does not have: users drop photographs and keep the file."""

import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromGcpList
from orthomill.tasks.orientation.control.control_files import read_control
from orthomill.tasks.orientation.control.control_system import control_from_files
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list

PHOTOS = Photos(
    photos=tuple(Photo(name=n, path=f"in/{n}.jpg", width=100, height=80, bands=3, dtype="uint8", camera="c") for n in ("a", "b"))
)
POINTS = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\nP1,control,1,2,3,1,1,1\nP2,check,4,5,6,1,1,1\nP3,tie,,,,,,\n"
MEASURED = "name,photo,col,row,sigma\nP1,a,10,20,1\nP1,b,11,20,1\nP2,a,30,40,1\nP3,a,5,5,1\nP3,b,6,5,1\n"
GONE = "name,photo,col,row,sigma\nP1,a,10,20,1\nP1,z.jpg,11,20,1\nP2,z.jpg,30,40,1\nP3,a,5,5,1\nP3,y,6,5,1\n"
DISTANCES = "from,to,metres,sigma\nP1,P3,12.5,0.01\n"


def test_lines_of_absent_photographs_are_skipped_and_told():
    control = read_control(PHOTOS, POINTS, MEASURED + "P1,z.jpg,12,20,1\n")
    assert control.points == read_control(PHOTOS, POINTS, MEASURED).points
    (finding,) = control.findings
    assert (finding.measurements, finding.photos, finding.lost) == (1, ("z.jpg",), ())
    assert "1 measurement of control points was skipped" in finding.sentence and not finding.grave


def test_points_without_enough_other_measurements_are_left_out_with_their_distances():
    control = read_control(PHOTOS, POINTS, GONE, DISTANCES)
    assert [point.name for point in control.points] == ["P1"] and control.distances == ()
    (finding,) = control.findings
    assert finding.lost == ("P2", "P3"), "a tie point needs two rays"
    assert "P2, P3 are measured in no other and left out" in finding.sentence and finding.grave


def test_a_project_may_insist_on_all_photographs():
    with pytest.raises(WorkflowError, match=r"line 3, point P1 is measured in the photograph 'z\.jpg', which the project does not"):
        control_from_files(PHOTOS, POINTS, GONE, None, "EPSG:2100", DISTANCES, absent="refuse")


def test_names_that_fit_no_photograph_are_no_dropped_photographs():
    with pytest.raises(WorkflowError, match="None of the photographs that control points are measured in is in the project: IMG_a"):
        read_control(PHOTOS, POINTS, MEASURED.replace(",a,", ",IMG_a,").replace(",b,", ",IMG_b,"))


def test_a_line_without_a_photograph_is_still_a_mistake():
    with pytest.raises(WorkflowError, match="photograph '', which the project does not have"):
        read_control(PHOTOS, POINTS, MEASURED + "P1,,12,20,1\n")


def gcp_list(*lines: str, **more):
    source = ControlFromGcpList(kind="gcp_list", path="gcp_list.txt", **more)
    return read_gcp_list(PHOTOS, "\n".join(("EPSG:2100", *lines)), source).control


def test_lines_of_a_list_are_skipped_alike():
    control = gcp_list("1 2 3 4 5 a.jpg g1", "1 2 3 4 5 z.jpg g1", "6 7 8 4 5 z.jpg g2")
    assert [point.name for point in control.points] == ["g1"]
    assert control.findings[0].photos == ("z.jpg",) and control.findings[0].lost == ("g2",)
    with pytest.raises(WorkflowError, match=r"line 3: point g1 is measured in the photograph 'z\.jpg'"):
        gcp_list("1 2 3 4 5 a.jpg g1", "1 2 3 4 5 z.jpg g1", absent="refuse")
    with pytest.raises(WorkflowError, match="None of the photographs"):
        gcp_list("1 2 3 4 5 z.jpg g1")
