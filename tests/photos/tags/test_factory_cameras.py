"""Cameras that the tags describe: conventions, and the traps."""

import pytest

from orthomill.tasks.photos.tags.factory_cameras import PictureFrame, factory_camera, was_dewarped, written_width

YARD = {
    "drone-dji:DewarpData": "2022-03-02;1973.09,1955.65,-19.04,-11.42,-0.42275,0.3691,0.0040638,0.0040638,-0.2643",
    "drone-dji:DewarpFlag": "0",
    "drone-dji:CalibratedFocalLength": "1913.333374",
    "drone-dji:CalibratedOpticalCenterX": "800.000000",
    "drone-dji:CalibratedOpticalCenterY": "650.000000",
}
FRAME = PictureFrame(1600, 1300, 1600)


def test_dji_counts_from_the_centre_and_downwards():
    camera = factory_camera(YARD, FRAME)
    assert (camera.kind, camera.c, camera.x0, camera.y0) == ("calibrated", 1955.65, -19.04, 11.42)
    assert (camera.k1, camera.k2, camera.k3, camera.p1, camera.p2) == (-0.42275, 0.3691, -0.2643, 0.0040638, 0.0040638)
    assert camera.affinity == pytest.approx(1973.09 / 1955.65 - 1.0)


def test_a_reduced_file_has_a_smaller_camera_of_the_same_lens():
    camera = factory_camera(YARD, PictureFrame(400, 325, 1600))
    assert (camera.c, camera.x0, camera.y0, camera.k1) == pytest.approx((1955.65 / 4, -4.76, 2.855, -0.42275))
    assert written_width(YARD, 400) == 1600 and written_width(YARD, 1600) == 1600 and written_width({}, 400) == 400


def test_a_dewarped_picture_has_no_distortion():
    camera = factory_camera({**YARD, "drone-dji:DewarpFlag": "1"}, FRAME)
    assert (camera.c, camera.x0, camera.k1, camera.affinity) == (1955.65, 0.0, 0.0, 0.0)
    assert was_dewarped({"drone-dji:DewarpFlag": "1"}) and not was_dewarped(YARD)


def test_the_design_is_only_a_constant():
    plain = {name: value for name, value in YARD.items() if "DewarpData" not in name}
    camera = factory_camera(plain, FRAME)
    assert (camera.kind, camera.c, camera.x0, camera.k1) == ("design", 1913.333374, 0.0, 0.0)


@pytest.mark.parametrize(
    "change",
    [
        # A thermal camera: micrometres, and no optical centre.
        {"drone-dji:CalibratedFocalLength": "9100.0", "drone-dji:CalibratedOpticalCenterX": "0"},
        {"drone-dji:CalibratedFocalLength": "0"},
        {"drone-dji:CalibratedFocalLength": "100000"},
    ],
)
def test_what_is_no_camera_is_none(change):
    plain = {name: value for name, value in YARD.items() if "DewarpData" not in name}
    assert factory_camera({**plain, **change}, FRAME) is None


@pytest.mark.parametrize(
    "data",
    [
        "",
        "2022-03-02;",
        "2022-03-02;0,0,0,0,0,0,0,0,0",
        "2022-03-02;1,2,3",
        "x;1973,1955,-900,0,0,0,0,0,0",
        "1e400,1,1,1,1,1,1,1,1",
    ],
)
def test_dewarp_data_that_is_none(data):
    found = factory_camera({**YARD, "drone-dji:DewarpData": data}, FRAME)
    assert found is None or found.kind == "design"


def test_skydio_counts_from_the_corner_and_has_three_numbers():
    """The values of its support page for the camera of the Skydio 2, the optical centre moved by (10, -20) px."""
    values = {
        "CalibratedFocalLengthX": "2380.0",
        "CalibratedFocalLengthY": "2376.5625",
        "CalibratedOpticalCenterX": "2037.5",
        "CalibratedOpticalCenterY": "1499.5",
        "DewarpData": "0.13000, -0.24000, 0.10400",
    }
    tags = {f"drone-skydio:{name}": value for name, value in values.items()}
    camera = factory_camera(tags, PictureFrame(4056, 3040, 4056))
    assert (camera.c, camera.x0, camera.y0) == pytest.approx((2376.5625, 10.0, 20.0))
    assert (camera.k1, camera.k2, camera.k3, camera.p1) == (0.13, -0.24, 0.104, 0.0)
    assert factory_camera(tags, PictureFrame(2028, 1520, 4056)).x0 == pytest.approx(5.0)


SEQUOIA = {
    "Camera:ModelType": "perspective",
    "Camera:PerspectiveFocalLength": "4.8",
    "Camera:PrincipalPoint": "3.1,2.3",
    "Camera:PerspectiveDistortion": "0.1,-0.2,0.3,0.001,-0.002",
    "FocalPlaneXResolution": "(750)",
    "FocalPlaneResolutionUnit": "4",
}


def test_pix4d_measures_in_millimetres_from_the_corner():
    camera = factory_camera(SEQUOIA, PictureFrame(4608, 3456, 4608))
    assert (camera.c, camera.x0, camera.y0) == pytest.approx((3600.0, 3.1 * 750 - 2304, 1728 - 2.3 * 750))
    assert (camera.k3, camera.p1, camera.p2) == (0.3, 0.001, -0.002)


@pytest.mark.parametrize(
    "change", [{"Camera:ModelType": "fisheye"}, {"FocalPlaneXResolution": ""}, {"Camera:PrincipalPoint": "3.1"}]
)
def test_pix4d_cameras_that_cannot_be_used(change):
    assert factory_camera({**SEQUOIA, **change}, PictureFrame(4608, 3456, 4608)) is None
