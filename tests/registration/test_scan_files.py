"""Files of scans and control, right and wrong."""

import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.registration.scan_files import read_scan, read_surveyed

CONTROL = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\n"


def test_a_scan_may_tell_the_standard_error_of_each_target():
    found = read_scan("\ufeff# scanner A\nname, x, y, z, sigma\nT1, 1, 2, 3, 0.004\nT2,4,5,6\n", "a.csv", 0.002)
    assert found["T1"].xyz == (1.0, 2.0, 3.0) and (found["T1"].sigma, found["T2"].sigma) == (0.004, 0.002)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "a.csv lacks the column"),
        ("name,x,y\nT1,1,2\n", r"lacks the column\(s\) z"),
        ("name,x,y,z\n", "holds no targets"),
        ("name,x,y,z\nT1,1,2,wall\n", "line 2, target T1: z is 'wall', which must be a number"),
        ("name,x,y,z,sigma\nT1,1,2,3,0\n", "sigma is '0', which must be a positive number"),
        ("name,x,y,z\nT1,1,2,3\n#\nT1,1,2,4\n", "line 4, target T1 occurs twice"),
        ("name,x,y,z\nT1,nan,2,3\n", "x is 'nan'"),
    ],
)
def test_mistakes_of_a_scan_are_told(text, said):
    with pytest.raises(WorkflowError, match=said):
        read_scan(text, "a.csv", 0.002)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("P1,tie,1,2,3,1,1,1", "role 'tie'; allowed are control and check"),
        ("P1,control,1,2,3,0,1,1", "sigma_x is '0'"),
        ("P1,control,1,2,3,1,1,1\nP1,check,1,2,3,1,1,1", "line 3, point P1 occurs twice"),
    ],
)
def test_mistakes_of_control_are_told(row, said):
    with pytest.raises(WorkflowError, match=said):
        read_surveyed(CONTROL + row + "\n")
