"""Settings of the project arrive where they count: each of these tests fails if its setting were ignored."""

import pytest

from orthomill.schemas.photo import Header, Photo, Photos
from orthomill.schemas.project import CameraFromChessboards, ControlFromGcpList, PhotoFolder, PositionsFromExif
from orthomill.tasks.calibration.plan.chessboard_jobs import _target
from orthomill.tasks.calibration.solving import solving
from orthomill.tasks.calibration.solving.solving import CalibrationTarget, with_uncertain_boards
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list
from orthomill.tasks.photos.index import Limits, index_photos

TAGS = {"GPSLatitude": "39.36", "GPSLatitudeRef": "N", "GPSLongitude": "22.94", "GPSLongitudeRef": "E", "GPSAltitude": "100"}
HEADER = Header(path="photos/a.jpg", width=4000, height=3000, bands=3, dtype="uint8", tags=TAGS)
PHOTOS = Photos(photos=(Photo(name="a", path="a.jpg", width=100, height=80, bands=3, dtype="uint8", camera="c"),))
LIST = "EPSG:2100\n407100 4357010 101 10 20 a.jpg g1\n"


def position_sigma(**more) -> tuple[float, float, float]:
    positions = PositionsFromExif(kind="exif", **more)
    (photo,) = index_photos((HEADER,), "EPSG:2100", positions, Limits(megapixels=50)).photos.photos
    return photo.position_sigma


def test_standard_errors_of_exif_positions():
    assert position_sigma() == (3.0, 3.0, 5.0)
    assert position_sigma(sigma_height=0.75) == (3.0, 3.0, 0.75)
    assert position_sigma(sigma_plan=0.5) == (0.5, 0.5, 5.0)


def control_point(**more):
    (point,) = read_gcp_list(PHOTOS, LIST, ControlFromGcpList(kind="gcp_list", path="gcp_list.txt", **more)).control.points
    return point


def test_standard_errors_of_a_gcp_list():
    assert control_point().sigma == (0.03, 0.03, 0.05) and control_point().measurements == {"a": (10, 20, 1.0)}
    assert control_point(sigma_height=0.2).sigma == (0.03, 0.03, 0.2)
    assert control_point(sigma_plan=0.2).sigma == (0.2, 0.2, 0.05)
    assert control_point(sigma_px=0.4).measurements == {"a": (10, 20, 0.4)}


def test_check_points_and_the_origin_of_a_gcp_list():
    assert control_point().role == "control" and control_point(check=("g1",)).role == "check"
    assert control_point(origin="corner").measurements == {"a": (9.5, 19.5, 1.0)}


class Index:
    """The size of the photographs of a calibration."""

    size = (4000, 3000)


def target(**more) -> CalibrationTarget:
    photographs = PhotoFolder(kind="folder", path="boards")
    source = CameraFromChessboards(kind="chessboards", photographs=photographs, corners=(5, 6), square=0.05, **more)
    return _target(Index(), source)


class Adjusted:
    """An adjustment of exact boards, as far as the second one needs it."""

    network, state, corners, sigma0 = target().network(1, 1, ("c",)), None, None, 0.25


@pytest.mark.parametrize(
    ("settings", "sigma"),
    [
        ({"sigma_in_plane": 2e-4}, (2e-4, 2e-4, 0.0)),
        ({"sigma_height": 5e-4}, (0.0, 0.0, 5e-4)),
        ({"sigma_in_plane": 1e-4, "sigma_height": 3e-4}, (1e-4, 1e-4, 3e-4)),
    ],
)
def test_standard_errors_of_boards_weight_their_corners(monkeypatch, settings, sigma):
    monkeypatch.setattr(solving, "adjust", lambda network, state, corners: network)
    network = with_uncertain_boards(target(**settings), Adjusted)
    assert network.local_sigma == sigma and network.image_sigma == 0.25


def test_exact_boards_are_adjusted_once():
    assert with_uncertain_boards(target(), Adjusted) is Adjusted


@pytest.mark.parametrize(("name", "value"), [("corners", (7, 4)), ("square", 0.1), ("boards", 3), ("arrangement", "space")])
def test_what_is_said_of_the_boards_is_what_is_looked_for(name, value):
    changed = target(**{name: value}) if name not in ("corners", "square") else _changed(name, value)
    assert getattr(changed, name) == value != getattr(target(), name)


def _changed(name: str, value: object) -> CalibrationTarget:
    said = {"kind": "chessboards", "photographs": {"kind": "folder", "path": "b"}, "corners": (5, 6), "square": 0.05, name: value}
    return _target(Index(), CameraFromChessboards.model_validate(said))
