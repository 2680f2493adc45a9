"""Control from OpenDroneMap's list and in reference systems of its own; control of another site is told and set aside."""

import numpy as np
import pytest
from orienting import orient
from pyproj import Transformer
from simulated_block import two_strips

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromGcpList
from orthomill.tasks.geometry.survey_system import transform_surveyed, vertical_name
from orthomill.tasks.orientation.control.control_system import control_from_files, control_from_list
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list

LIST = ControlFromGcpList(kind="gcp_list", path="gcp_list.txt", check=("g2",))
CRS = "EPSG:2100"


def photos(place=(407000.0, 4357000.0, 1100.0)):
    return Photos(
        photos=tuple(
            Photo(
                name=n,
                path=f"in/{n}.JPG",
                width=100,
                height=80,
                bands=3,
                dtype="uint8",
                camera="c",
                position=None if place is None else (place[0] + 300 * i, place[1], place[2]),
            )
            for i, n in enumerate("ab")
        )
    )


GCP = """EPSG:2100
407100.5 4357010.25 101.5 10.5 20.5 a.JPG g1
407100.5 4357010.25 101.5 30 40 b.JPG g1
407200 4357110 99 50 60 a.JPG g2 extra words
# a comment
407300 4357110 99 7 8 b.JPG
"""


def test_a_gcp_list_is_read_whole():
    found = read_gcp_list(photos(), GCP, LIST)
    assert found.crs == "EPSG:2100"
    points = {point.name: point for point in found.control.points}
    assert list(points) == ["g1", "g2", "407300 4357110 99"]
    assert points["g1"].measurements == {"a": (10.5, 20.5, 1.0), "b": (30, 40, 1.0)}
    assert points["g1"].xyz == (407100.5, 4357010.25, 101.5) and points["g1"].sigma == (0.03, 0.03, 0.05)
    assert [point.role for point in points.values()] == ["control", "check", "control"]


def test_the_workflow_names_the_system_that_the_list_calls_by_a_strange_name():
    strange = GCP.replace("EPSG:2100", "HGRS")
    assert read_gcp_list(photos(), strange, LIST).crs == "HGRS"
    assert read_gcp_list(photos(), strange, LIST.model_copy(update={"crs": "EPSG:2100"})).crs == "EPSG:2100"


def test_pixels_counted_from_the_corner_move_by_half_a_pixel():
    found = read_gcp_list(photos(), GCP, LIST.model_copy(update={"origin": "corner"}))
    assert found.control.points[0].measurements["a"] == (10.0, 20.0, 1.0)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "GCP list is empty"),
        ("EPSG:2100\n1 2 3 4 5\n", "line 2: '1 2 3 4 5' must hold X Y Z col row photograph"),
        ("EPSG:2100\n1 2 3 400 5 a.JPG g2\n", "point g2 is measured at col 400, row 5, outside of a"),
        ("EPSG:2100\n1 2 3 4 5 a.JPG g2\n1 2 4 4 5 b.JPG g2\n", "but others in an earlier line"),
        ("EPSG:2100\n1 2 3 4 5 a.JPG g7\n", "check point g2 is not in the GCP list"),
    ],
)
def test_every_mistake_of_a_list_is_told(text, sentence):
    with pytest.raises(WorkflowError, match=sentence.replace("(", r"\(")):
        read_gcp_list(photos(), text, LIST)


def test_control_in_degrees_is_carried_to_the_project():
    to_degrees = Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(407100.5, 4357010.25)
    text = GCP.replace("EPSG:2100", "EPSG:4326").replace("407100.5 4357010.25", f"{lon!r} {lat!r}")
    text = "\n".join(line for line in text.splitlines() if "g1" in line or "EPSG" in line)
    control = control_from_list(photos(), text, LIST.model_copy(update={"check": ()}), CRS)
    assert np.allclose(control.points[0].xyz, (407100.5, 4357010.25, 101.5), atol=0.05)


def test_old_names_of_utm_zones_are_understood():
    xyz, _ = transform_surveyed(np.array([[500000.0, 4000000.0, 7.0]]), "WGS84 UTM 34N", "EPSG:32634")
    assert np.allclose(xyz, [[500000, 4000000, 7]])


def test_what_heights_count_from_is_told():
    assert vertical_name("EPSG:2100") is None
    assert vertical_name("EPSG:2100+5773") == "EGM96 height"
    _, only = transform_surveyed(np.array([[407000.0, 4357000.0, 7.0]]), "EPSG:2100+5773", "EPSG:32634")
    assert only == "EPSG:2100+5773"


@pytest.mark.parametrize(
    ("change", "fit"),
    [
        (lambda xyz: as_system(xyz, "EPSG:32634"), "would be there in EPSG:32634"),
        (lambda xyz: as_system(xyz, "EPSG:32634")[:, [1, 0, 2]], "would be there in EPSG:32634 with X and Y exchanged"),
        (
            lambda xyz: xyz + np.array([9e6, 0, 0]),
            "check whether the list is of this site, and the reference system, the order of the axes and the zone",
        ),
    ],
)
def test_control_of_another_site_is_named_with_the_system_that_fits(change, fit):
    xyz = change(np.array([[407100.0, 4357010.0, 100.0], [407300.0, 4357400.0, 120.0], [407000.0, 4357100.0, 110.0]]))
    rows = "".join(f"P{i},control,{x!r},{y!r},{z!r},0.1,0.1,0.1\n" for i, (x, y, z) in enumerate(xyz.tolist()))
    measured = "".join(f"P{i},{name},10,20,0.5\n" for i in range(3) for name in "ab")
    header = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\n", "name,photo,col,row,sigma\n"
    control = control_from_files(photos(), header[0] + rows, header[1] + measured, None, CRS)
    assert control.points == () and fit in control.findings[0].sentence


def test_control_in_the_projects_system_that_is_said_to_be_in_another_is_told():
    rows = "P0,control,407100,4357010,100,0.1,0.1,0.1\nP1,control,407300,4357400,120,0.1,0.1,0.1\n"
    measured = "".join(f"P{i},{name},10,20,0.5\n" for i in range(2) for name in "ab")
    header = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\n", "name,photo,col,row,sigma\n"
    control = control_from_files(photos(), header[0] + rows, header[1] + measured, "EPSG:32634", CRS)
    assert "would be there in EPSG:2100: state it (control > crs)." in control.findings[0].sentence


def as_system(xyz, name):
    x, y = Transformer.from_crs(CRS, name, always_xy=True).transform(xyz[:, 0], xyz[:, 1])
    return np.column_stack([x, y, xyz[:, 2]])


def test_without_positions_nothing_tells_the_site():
    text = "EPSG:2100\n900000 4400002 3 4 5 a.JPG g2\n"
    assert len(control_from_list(photos(None), text, LIST, CRS).points) == 1


def test_the_block_is_oriented_without_control_of_another_site():
    block = two_strips(6)
    points = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\n" + "".join(
        f"{p.name},{p.role},{p.xyz[0] + 3e5!r},{p.xyz[1] + 3e5!r},{p.xyz[2]!r},0.02,0.02,0.02\n" for p in block.control.points
    )
    measured = "name,photo,col,row,sigma\n" + "".join(
        f"{p.name},{name},{col!r},{row!r},{s!r}\n" for p in block.control.points for name, (col, row, s) in p.measurements.items()
    )
    control = control_from_files(block.photos, points, measured, None, CRS)
    assert control.findings[0].code == "control_elsewhere" and control.findings[0].fits is None
    oriented = orient(type(block)(**{**vars(block), "control": control}))
    assert len(oriented["block"].photos) == 6 and oriented["block"].datum.startswith("GNSS")
