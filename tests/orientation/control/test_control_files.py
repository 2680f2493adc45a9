"""Control from CSV texts: what is right is read, what is wrong is told, all at once."""

import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.observations import Distance
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.orientation.control.control_files import read_control
from orthomill.tasks.orientation.control.control_system import control_from_files

PHOTOS = Photos(
    photos=tuple(Photo(name=n, path=f"in/{n}.jpg", width=100, height=80, bands=3, dtype="uint8", camera="c") for n in ("a", "b"))
)
POINTS = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\nP1,control,1,2,3,0.1,0.1,0.2\nP2,check,4,5,6,0.1,0.1,0.2\n"
MEASURED = "name,photo,col,row,sigma\nP1,a,10,20,0.5\nP1,b.jpg,11,21,0.5\nP2,a,30,40,0.3\n"


def test_points_and_measurements_are_put_together():
    control = read_control(PHOTOS, POINTS, MEASURED)
    assert [p.name for p in control.points] == ["P1", "P2"]
    assert control.points[0].measurements == {"a": (10, 20, 0.5), "b": (11, 21, 0.5)}
    assert control.points[1].role == "check" and control.points[1].sigma == (0.1, 0.1, 0.2)


@pytest.mark.parametrize(
    ("points", "measured", "sentence"),
    [
        (POINTS + "P1,control,1,2,3,1,1,1\n", MEASURED, "line 4, point P1 occurs twice"),
        (POINTS, MEASURED + "P9,a,1,1,1\n", "point P9 is not in the control points file"),
        (POINTS, MEASURED + "P2,b,200,10,1\n", "outside of b, which has 100 columns and 80 rows"),
        (POINTS, MEASURED + "P1,a,1,1,1\n", "measured twice in a"),
        (POINTS + "P3,control,1,2,3,1,1,1\n", MEASURED, "Control point P3 is measured in no photograph"),
        (POINTS.replace("0.2\nP2", "0\nP2"), MEASURED, "sigma_z is '0', which must be a positive number"),
        (POINTS.replace("4,5,6", "4,east,6"), MEASURED, "y is 'east', which must be a number"),
        (POINTS.replace("check", "chek"), MEASURED, "role 'chek'; allowed are control, check and tie"),
        (POINTS.replace("sigma_z", "tz"), MEASURED, "lacks the column"),
        ("", MEASURED, "control points file is empty"),
        (POINTS.splitlines()[0], MEASURED.splitlines()[0], "The control points file holds no points"),
        (POINTS.replace("4,5,6", "4e12,5,6"), MEASURED, "which is no coordinate on the Earth"),
        (POINTS.replace("0.1,0.1,0.2\nP2", "1e-300,0.1,0.2\nP2"), MEASURED, "sigma_x is 1e-300, but a standard error is between"),
        (POINTS, MEASURED + '"P1,b\n', "point P1,b: col is '', which must be a number"),
        (POINTS + "x" * 200_000, MEASURED, "point  has the role ''"),
    ],
)
def test_every_mistake_is_one_sentence(points, measured, sentence):
    with pytest.raises(WorkflowError, match=sentence.replace("(", r"\(")):
        read_control(PHOTOS, points, measured)


def test_measurements_that_cannot_be_read_are_one_sentence_and_not_one_for_every_point():
    with pytest.raises(WorkflowError, match="measurements file follows no format that is known") as told:
        read_control(PHOTOS, POINTS, "where,what\n1,2\n")
    assert "measured in no photograph" not in str(told.value)


def test_a_check_point_without_a_mark_is_kept_for_the_heights_of_products():
    control = read_control(PHOTOS, POINTS + "V1,check,1,2,3,0.1,0.1,0.1\n", MEASURED)
    assert control.points[2].name == "V1" and control.points[2].measurements == {}
    (finding,) = control.findings
    assert finding.sentence.startswith("V1 is marked in no photograph. It tests the heights") and not finding.grave


def test_all_mistakes_are_told_together():
    with pytest.raises(WorkflowError) as told:
        read_control(PHOTOS, POINTS + "P3,control,1,2,3,1,1,1\n", MEASURED + "P9,a,1,1,1\nP2,b,200,10,1\n")
    assert len(str(told.value).splitlines()) == 3


TIES = POINTS + "P3,tie,,,,,,\n"
SEEN = MEASURED + "P3,a,50,60,1\nP3,b,51,60,1\n"
LENGTHS = "from,to,metres,sigma\nP1,P3,12.5,0.01\n"


def test_distances_and_tie_points_are_read():
    control = read_control(PHOTOS, TIES, SEEN, LENGTHS)
    assert control.points[2].role == "tie"
    assert control.distances == (Distance(first="P1", second="P3", length=12.5, sigma=0.01),)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("P1,P9,1,1", "line 3, P1 to P9: the point 'P9' is not in the control points file"),
        ("P1,P2,1,1", "P2 is measured in 1 photographs, but needs two"),
        ("P1,P1,1,1", "needs two different points"),
        ("P1,P3,-4,1", "metres is -4, which must be a positive number"),
        ("P1,P3,4,0", "sigma is '0', which must be a positive number"),
    ],
)
def test_every_mistake_of_a_distance_is_one_sentence(line, sentence):
    with pytest.raises(WorkflowError, match=sentence):
        read_control(PHOTOS, TIES, SEEN, LENGTHS + line + "\n")


def test_distances_of_control_on_another_site_still_count():
    here = Photos(photos=tuple(p.model_copy(update={"position": (5e5, 4e6, 100.0)}) for p in PHOTOS.photos))
    control = control_from_files(here, TIES, SEEN, None, "EPSG:32634", LENGTHS)
    assert [(p.name, p.role) for p in control.points] == [("P1", "tie"), ("P3", "tie")]
    assert len(control.distances) == 1 and control.findings[0].code == "control_elsewhere"


def test_of_a_hundred_thousand_mistakes_ten_are_told_and_the_rest_is_counted():
    with pytest.raises(WorkflowError) as told:
        read_control(PHOTOS, POINTS, MEASURED + "P9,a,1,1,1\n" * 100_000)
    lines = str(told.value).splitlines()
    assert len(lines) == 11 and lines[-1] == "... and 99990 more."
