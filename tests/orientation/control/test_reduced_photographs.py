"""Lists that were measured before the photographs were reduced are read as such, and wrong lines are still wrong."""

import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.control_findings import MeasurementsOfOriginals, MeasurementsReduced
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromGcpList
from orthomill.tasks.orientation.control.control_system import control_from_files, control_from_list

CRS = "EPSG:32634"
FIRST = "500000 4000000 100"


def photographs(original=(4000, 3000)):
    size = {"width": 1000, "height": 750, "bands": 3, "dtype": "uint8", "camera": "cam"}
    return Photos(photos=tuple(Photo(name=name, path=f"{name}.jpg", original=original, **size) for name in "ab"))


def listed(*lines):
    return "\n".join([CRS, *lines])


def read(text, photos):
    return control_from_list(photos, text, ControlFromGcpList(kind="gcp_list", path="gcp_list.txt"), CRS)


WHOLE = listed(f"{FIRST} 3999 2999 a.jpg p", f"{FIRST} 2001.5 1001.5 b.jpg p")


def test_pixels_of_the_originals_become_those_of_the_photographs():
    found = read(WHOLE, photographs())
    (point,) = found.points
    assert point.measurements["a"][:2] == pytest.approx((999.375, 749.375)), "the last pixel of four by four, from their centres"
    assert point.measurements["b"][:2] == pytest.approx((500.0, 250.0))
    (finding,) = found.findings
    assert finding == MeasurementsOfOriginals(measurements=2, outside=2, original=(4000, 3000), reduced=(1000, 750))
    said = finding.sentence
    assert "2 of 2 control measurements" in said and "4000 x 3000 to 1000 x 750 px" in said and not finding.grave


def test_marks_of_photographs_that_were_reduced_twice_are_those_of_the_larger_copies():
    """They reach half of the frame that the camera wrote, and nearly all of one twice as large as the photographs."""
    corners = [(1980, 1480), (1500, 900), (30, 40), (700, 1400), (1900, 100), (1000, 750)]
    lines = [f"{500000 + 40 * i} 4000000 100 {col} {row} {'ab'[i % 2]}.jpg p{i}" for i, (col, row) in enumerate(corners)]
    found = read(listed(*lines), photographs())
    assert found.points[0].measurements["a"][:2] == pytest.approx((989.75, 739.75), abs=0.01)
    factors = [finding.factor for finding in found.findings if isinstance(finding, MeasurementsReduced)]
    assert factors == [2.0] and not any(isinstance(finding, MeasurementsOfOriginals) for finding in found.findings)


def test_tables_are_read_in_the_same_frame():
    points = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\np,control,500000,4000000,100,0.1,0.1,0.1\n"
    measurements = "name,photo,col,row,sigma\np,a,3999,2999,1\np,b,2001.5,1001.5,1\n"
    found = control_from_files(photographs(), points, measurements, None, CRS)
    assert found.points[0].measurements["b"][:2] == pytest.approx((500.0, 250.0)) and len(found.findings) == 1


def test_pixels_that_the_photographs_hold_are_theirs():
    found = read(listed(f"{FIRST} 999 749 a.jpg p", f"{FIRST} 10 20 b.jpg p"), photographs())
    assert found.points[0].measurements["b"][:2] == (10.0, 20.0) and found.findings == ()


@pytest.mark.parametrize(
    ("text", "original"),
    [
        (WHOLE, None),
        (listed(f"{FIRST} 3999 2999 a.jpg p", f"{FIRST} 5000 10 b.jpg p"), (4000, 3000)),
        (listed(f"{FIRST} 3999 2999 a.jpg p", f"{FIRST} 10 10 b.jpg p"), (4000, 3000)),
    ],
    ids=["not reduced", "outside of the originals", "one wrong line"],
)
def test_what_the_originals_do_not_explain_is_refused_as_before(text, original):
    with pytest.raises(WorkflowError, match="outside of a, which has 1000 columns and 750 rows"):
        read(text, photographs(original))


def test_shares_of_the_frame_are_no_pixels():
    lines = [f"{FIRST[:-3]}{100 + i} 0.{i}5 0.4{i} {'ab'[i % 2]}.jpg p{i}" for i in range(6)]
    with pytest.raises(WorkflowError, match=r"All 6 control measurements lie within the first pixel .* shares of the width"):
        read(listed(*lines), photographs(None))
