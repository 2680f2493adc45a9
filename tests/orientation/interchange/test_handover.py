"""The block for other programs: a ground point projected by the files' own conventions lies where our equations have it."""

import json
import struct
from itertools import pairwise
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from pyproj import Transformer

from orthomill.schemas.camera import Camera, DivisionLens, RationalLens
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.observations import Control, ControlPoint, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromGcpList
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.imagery.undistorted import ideal_camera, undistorted_photograph
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list
from orthomill.tasks.orientation.interchange.colmap import read_colmap
from orthomill.tasks.orientation.results.handover import OrientedProject, handed_files
from orthomill.tasks.orientation.start.georeference import own_system

BROWN = Camera(name="cam", width=640, height=480, c=520.0, x0=3.2, y0=-2.1, k1=-0.05, k2=0.02, k3=-0.004, p1=3e-4, p2=-2e-4)
CENTRES = ((407000.0, 4357000.0, 90.0), (407015.0, 4357002.0, 91.0), (407030.0, 4356999.0, 89.5))
ANGLES = ((1.2, -2.3, 10.0), (-0.7, 1.9, 12.0), (3.0, 0.5, -170.0))


def project(camera=BROWN, crs="EPSG:2100", flag=1) -> OrientedProject:
    """Three photographs of ground at 40 m, with true measurements of 60 points and one control and check point."""
    names = ("a", "b/c", "d")
    photos = Photos(
        photos=tuple(
            Photo(
                name=n,
                path=f"{n}.JPG",
                bands=3,
                dtype="uint8",
                camera="cam",
                width=640,
                height=480,
                exif_orientation=flag,
                time="2016-09-21T15:31:25.5",
            )
            for n in names
        )
    )
    block = Block(
        crs=crs,
        cameras={"cam": camera},
        of_photo=dict.fromkeys(names, "cam"),
        photos=tuple(
            ExteriorOrientation(photo=n, centre=c, omega_phi_kappa=a) for n, c, a in zip(names, CENTRES, ANGLES, strict=True)
        ),
        datum="",
        sigma0_px=0.3,
        redundancy=1,
        iterations=1,
        ground_low=38.0,
        ground_high=42.0,
    )
    random = np.random.default_rng(0)
    ground = np.column_stack([random.uniform(-10, 40, 60), random.uniform(-15, 15, 60), random.uniform(38, 42, 60)]) + ORIGIN
    seen = [(t, p, *pixel) for p, n in enumerate(names) for t, pixel in enumerate(block_view(block, n).project(ground))]
    inside = [row for row in seen if 0 <= row[2] < 639 and 0 <= row[3] < 479]
    rows = np.array(sorted(inside))
    nothing = np.zeros(len(rows), np.float32)
    # Every tenth measurement was rejected; tracks of points have any numbers, in any order.
    used, track = np.arange(len(rows)) % 10 != 3, (rows[:, 0] * 7 + 100).astype(np.int32)
    rays = ImageResiduals(track, rows[:, 1].astype(np.int32), rows[:, 2], rows[:, 3], nothing, nothing, nothing, used)
    order = random.permutation(60)
    small = np.full(60, 0.01, np.float32)
    points = GroundPoints(
        (order * 7 + 100).astype(np.int32), *ground[order].T, small, small, small, np.full(60, 3, np.int16), small
    )
    marks = {names[p]: (float(c), float(r), 0.3) for t, p, c, r in inside if t == inside[0][0]}
    control = tuple(
        ControlPoint(name=role, role=role, xyz=tuple(ground[inside[0][0]]), sigma=(0.02,) * 3, measurements=marks)
        for role in ("control", "check", "tie")
    )
    return OrientedProject("site", photos, block, points, rays, Control(points=control))


ORIGIN = np.array([407000.0, 4357000.0, 0.0])
GROUND = ORIGIN + np.array([[2.0, 3.0, 40.0], [10.0, -4.0, 41.0], [18.0, 5.0, 38.5], [12.0, 0.5, 44.0]])


def texts(given, program, suffix=".jpg"):
    def read(name):
        return np.full((480, 640, 3), 90, np.uint8)

    return dict(handed_files(given, program, suffix, read))


def ideal(given, name):
    """Where our collinearity equations have the ground in the undistorted photograph."""
    view = block_view(given.block, name)
    return View(name, ideal_camera(view.camera), view.rotation, view.centre).project(GROUND)


def unpacked(data, at, form):
    values = struct.unpack_from(f"<{form}", data, at)
    return values, at + struct.calcsize(f"<{form}")


def colmap_binary(files):
    """A strict reader: everything is read, and nothing is left."""
    data, cameras = files["sparse/cameras.bin"], {}
    (count,), at = unpacked(data, 0, "Q")
    for _ in range(count):
        (number, model, *known), at = unpacked(data, at, "iiQQ4d")
        assert model == 1
        cameras[number] = known
    assert at == len(data)
    data, images = files["sparse/images.bin"], {}
    (count,), at = unpacked(data, 0, "Q")
    for _ in range(count):
        (number, *pose, camera), at = unpacked(data, at, "i7di")
        end = data.index(b"\0", at)
        (size,), start = unpacked(data, end + 1, "Q")
        rows = [struct.unpack_from("<ddq", data, start + 24 * k) for k in range(size)]
        images[number], at = (pose, camera, data[at:end].decode(), rows), start + 24 * size
    assert at == len(data)
    data, points = files["sparse/points3D.bin"], {}
    (count,), at = unpacked(data, 0, "Q")
    for _ in range(count):
        (number, x, y, z, _r, _g, _b, error, size), at = unpacked(data, at, "Q3d3BdQ")
        points[number] = ((x, y, z), error, [struct.unpack_from("<ii", data, at + 8 * k) for k in range(size)])
        at += 8 * size
    assert at == len(data)
    return cameras, images, points


def colmap_text(files):
    lines = {
        name: [one for one in files[f"text/{name}.txt"].decode().split("\n") if one[:1] != "#"] for name in ("cameras", "images")
    }
    cameras = {int(n): list(map(float, rest)) for n, _, *rest in (one.split() for one in lines["cameras"] if one)}
    images = {}
    for pose, marks in zip(lines["images"][::2], lines["images"][1::2], strict=False):
        number, *numbers = pose.split()
        values = list(map(float, marks.split()))
        rows = list(zip(values[::3], values[1::3], map(int, values[2::3]), strict=True))
        images[int(number)] = (list(map(float, numbers[:7])), int(numbers[7]), numbers[8], rows)
    return cameras, images


def colmap_projection(pose, camera, points):
    """COLMAP's documentation: R(q) X + t, then fx x / z + cx."""
    w, x, y, z = pose[:4]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    u = points @ turn.T + pose[4:]
    _, _, fx, fy, cx, cy = camera
    return np.column_stack([fx * u[:, 0] / u[:, 2] + cx, fy * u[:, 1] / u[:, 2] + cy])


@pytest.mark.parametrize(
    "camera", [BROWN, BROWN.model_copy(update={"lens": RationalLens(k1=-0.1, k4=0.02, p1=1e-4), "affinity": 1e-3})]
)
def test_colmap_sees_the_ground_where_we_do_in_text_and_binary(camera):
    given = project(camera)
    files = texts(given, "colmap")
    cameras, images, points = colmap_binary(files)
    cameras_as_text, images_as_text = colmap_text(files)
    assert cameras == {1: pytest.approx(cameras_as_text[1], abs=1e-9)} and [i[2] for i in images.values()] == [
        "a.jpg",
        "b_c.jpg",
        "d.jpg",
    ]
    for number, name in enumerate(given.block.names, 1):
        pose, camera_number, _, rows = images[number]
        found = colmap_projection(pose, cameras[camera_number], GROUND - np.array([407000.0, 4357000.0, 0.0]))
        assert np.abs(found - 0.5 - ideal(given, name)).max() < 1e-6
        assert images_as_text[number][0] == pytest.approx(pose, abs=1e-12) and len(images_as_text[number][3]) == len(rows)
        # Measurements of points are where the points are seen, as they are free of errors here.
        seen = colmap_projection(pose, cameras[camera_number], np.array([points[row[2]][0] for row in rows]))
        assert np.abs(seen - [row[:2] for row in rows]).max() < 1e-6
    for number, (_, _, track) in points.items():
        assert all(images[image][3][own][2] == number for image, own in track)
    assert sum(len(track) for _, _, track in points.values()) == given.rays.used.sum()
    # Read back, the texts say where the block is: the origin that was taken off is noted in them.
    read = read_colmap(*(files[f"text/{name}.txt"].decode() for name in ("cameras", "images", "points3D")))
    for name, pose in zip(given.block.names, read.poses.values(), strict=True):
        assert pose.centre == pytest.approx(block_view(given.block, name).centre, abs=1e-6)
    assert files["stereo/fusion.cfg"] == b"a.jpg\nb_c.jpg\nd.jpg\n" and files["images/b_c.jpg"].shape == (480, 640, 3)


def openmvs(data):
    """A strict reader of version 2 of OpenMVS's Interface.h."""
    assert data[:4] == b"MVSI"
    (version, _), at = unpacked(data, 4, "II")
    assert version == 2

    def text(at):
        (size,), at = unpacked(data, at, "Q")
        return data[at : at + size].decode(), at + size

    platforms = []
    (count,), at = unpacked(data, at, "Q")
    for _ in range(count):
        _, at = text(at)
        (one,), at = unpacked(data, at, "Q")
        assert one == 1
        _, at = text(at)
        size, at = unpacked(data, at, "II")
        numbers, at = unpacked(data, at, "21d")
        (poses,), at = unpacked(data, at, "Q")
        rows = [struct.unpack_from("<12d", data, at + 96 * k) for k in range(poses)]
        platforms.append((size, np.reshape(numbers[:9], (3, 3)), rows))
        assert np.reshape(numbers[9:18], (3, 3)).tolist() == np.eye(3).tolist() and numbers[18:] == (0, 0, 0)
        at += 96 * poses
    images = []
    (count,), at = unpacked(data, at, "Q")
    for _ in range(count):
        name, at = text(at)
        place, at = unpacked(data, at, "3I")
        images.append((name, place))
    vertices = []
    (count,), at = unpacked(data, at, "Q")
    for _ in range(count):
        (*xyz, size), at = unpacked(data, at, "3fQ")
        vertices.append((xyz, [struct.unpack_from("<If", data, at + 8 * k)[0] for k in range(size)]))
        at += 8 * size
    for _ in range(5):
        (count,), at = unpacked(data, at, "Q")
        assert count == 0
    transform, at = unpacked(data, at, "16d")
    assert at == len(data) and np.reshape(transform, (4, 4)).tolist() == np.eye(4).tolist()
    return platforms, images, vertices


def test_openmvs_sees_the_ground_where_we_do():
    given = project()
    files = texts(given, "openmvs")
    platforms, images, vertices = openmvs(files["scene.mvs"])
    for name, (file, (platform, camera, pose)) in zip(given.block.names, images, strict=True):
        size, K, poses = platforms[platform]
        turn, centre = np.reshape(poses[pose][:9], (3, 3)), np.array(poses[pose][9:])
        u = (GROUND - np.array([407000.0, 4357000.0, 0.0]) - centre) @ turn.T @ K.T
        assert np.abs(u[:, :2] / u[:, 2:] - ideal(given, name)).max() < 1e-6
        assert camera == 0 and size == (640, 480) and file in files
    assert len(vertices) == 60 and sum(len(views) for _, views in vertices) == given.rays.used.sum()
    nearest = np.linalg.norm(
        np.array([xyz for xyz, _ in vertices])[:, None]
        + ORIGIN
        - np.column_stack([given.points.x, given.points.y, given.points.z]),
        axis=2,
    )
    assert nearest.min(axis=1).max() < 1e-4


def test_an_undistorted_photograph_shows_what_its_ideal_camera_sees():
    """A pattern on the ground, photographed by the lens and by the ideal camera."""

    def pattern(camera):
        view = View("a", camera, np.eye(3), np.array([0.0, 0.0, 100.0]))
        row, col = np.mgrid[:480, :640]
        x, y = view.at_height(np.column_stack([col.ravel(), row.ravel()]), 0.0)[:, :2].T
        value = 120 + 60 * np.sin(x / 6) + 40 * np.cos(y / 5)
        return np.rint(value).astype(np.uint8).reshape(480, 640, 1)

    found, wanted = undistorted_photograph(pattern(BROWN), BROWN), pattern(ideal_camera(BROWN))
    known = found > 0
    assert found.dtype == np.uint8 and known.mean() > 0.9
    assert np.abs(found.astype(int) - wanted)[known].max() <= 2


def opencv(rotation, centre, camera):
    """OpenCV's own projection of the ground by the values of cameras.json."""
    longer = max(camera["width"], camera["height"])
    K = np.array(
        [
            [camera["focal_x"] * longer, 0, camera["c_x"] * longer + (camera["width"] - 1) / 2],
            [0, camera["focal_y"] * longer, camera["c_y"] * longer + (camera["height"] - 1) / 2],
            [0, 0, 1],
        ]
    )
    lens = np.array([camera[k] for k in ("k1", "k2", "p1", "p2", "k3")])
    pixels, _ = cv2.projectPoints(GROUND - centre, np.array(rotation), np.zeros(3), K, lens)
    return pixels[:, 0]


def test_opendronemap_sees_the_ground_where_we_do():
    given = project()
    files = texts(given, "odm")
    shots, cameras = json.loads(files["shots.geojson"]), json.loads(files["cameras.json"])
    for name, shot in zip(given.block.names, shots["features"], strict=True):
        known = shot["properties"]
        found = opencv(known["rotation"], known["translation"], cameras[known["camera"]])
        assert np.abs(found - block_view(given.block, name).project(GROUND)).max() < 1e-3
        assert shot["geometry"]["coordinates"][:2] == pytest.approx([22.92, 39.35], abs=0.02)
        assert known["capture_time"] == 1474471885.5
    lines = files["geo.txt"].decode().splitlines()
    assert lines[0] == "EPSG:2100" and lines[2] == "c.JPG 407015.0000 4357002.0000 91.0000"


def test_marks_of_control_come_back_and_check_points_stay_apart():
    given = project()
    files = texts(given, "odm")
    source = ControlFromGcpList(kind="gcp_list", path="gcp_list.txt")
    point = read_gcp_list(given.photos, files["gcp_list.txt"].decode(), source).control.points[0]
    wanted = given.control.points[0]
    assert point.name == "control" and point.xyz == pytest.approx(wanted.xyz, abs=1e-4)
    # Files have no folders in their names there: b/c is found as c.
    for name in ("a", "d"):
        assert point.measurements[name][:2] == pytest.approx(wanted.measurements[name][:2], abs=1e-3)
    features = json.loads(files["ground_control_points.geojson"])["features"]
    assert [one["properties"]["id"] for one in features] == ["control", "check"]
    assert features[0]["geometry"]["coordinates"][:2] == pytest.approx([22.92, 39.35], abs=0.02)
    # Its marks are noisy by less than a pixel of these photographs, which is some centimetres.
    assert np.abs(features[0]["properties"]["error"]).max() < 0.5
    for seen in features[0]["properties"]["observations"]:
        assert np.subtract(seen["annotated"], seen["reprojected"]) == pytest.approx([0, 0], abs=3e-3)
    assert "check" in files["check_list.txt"].decode() and "check" not in files["gcp_list.txt"].decode()


def test_marks_are_those_of_the_files_where_exif_turns_them():
    """An upright photograph of 640 x 480 whose file is 480 x 640, turned by a quarter."""
    given = project(flag=6)
    rows = texts(given, "odm")["gcp_list.txt"].decode().splitlines()[1:]
    (col, row, _), (at, down) = given.control.points[0].measurements["a"], map(float, rows[0].split()[3:5])
    # Flag 6: the upright photograph is the file turned clockwise, so that its columns are rows from below.
    assert (at, down) == pytest.approx((row, 639 - col), abs=1e-3)


def metashape(root, label):
    """Sensor values and the camera's matrix from the camera to the chunk."""
    camera = next(one for one in root.iter("camera") if one.get("label") == label)
    calibration = root.find(f".//sensor[@id='{camera.get('sensor_id')}']/calibration")
    values = {child.tag: float(child.text) for child in calibration if child.tag != "resolution"}
    return values, np.reshape([float(v) for v in camera.find("transform").text.split()], (4, 4))


def metashape_projection(values, to_chunk, points, size=(640, 480)):
    """The manual's appendix D: frame cameras."""
    x, y, z = np.linalg.inv(to_chunk)[:3, :3] @ (points - to_chunk[:3, 3]).T
    x, y = x / z, y / z
    r2 = x * x + y * y
    radial = 1 + values["k1"] * r2 + values["k2"] * r2**2 + values["k3"] * r2**3
    xd = x * radial + values["p1"] * (r2 + 2 * x * x) + 2 * values["p2"] * x * y
    yd = y * radial + values["p2"] * (r2 + 2 * y * y) + 2 * values["p1"] * x * y
    u = size[0] / 2 + values["cx"] + xd * values["f"] + xd * values["b1"] + yd * values["b2"]
    return np.column_stack([u, size[1] / 2 + values["cy"] + yd * values["f"]])


SKEW = BROWN.model_copy(update={"affinity": 2e-3, "skew": -1e-3})


@pytest.mark.parametrize("camera", [BROWN, SKEW])
def test_metashape_sees_the_ground_where_we_do(camera):
    """In a system of its own to the last digit; on the earth but for the curvature of map and earth within a photograph."""
    given = project(camera, own_system(scaled=False))
    root = ElementTree.fromstring(texts(given, "metashape")["cameras.xml"])
    for name, label in zip(given.block.names, ("a", "c", "d"), strict=True):
        found = metashape_projection(*metashape(root, label), GROUND)
        assert np.abs(found - 0.5 - block_view(given.block, name).project(GROUND)).max() < 1e-3
    given = project(camera)
    root = ElementTree.fromstring(texts(given, "metashape")["cameras.xml"])
    place = root.find(".//component/transform")
    turn, origin = (np.array([float(v) for v in place.find(tag).text.split()]) for tag in ("rotation", "translation"))
    to_degrees = Transformer.from_crs("EPSG:2100", "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(GROUND[:, 0], GROUND[:, 1])
    earth = np.column_stack(Transformer.from_crs(4979, 4978, always_xy=True).transform(lon, lat, GROUND[:, 2]))
    chunk = (earth - origin) @ turn.reshape(3, 3)
    for name, label in zip(given.block.names, ("a", "c", "d"), strict=True):
        found = metashape_projection(*metashape(root, label), chunk)
        # The scale of the map here is 0.9997: 3e-4 of 300 px from the middle.
        assert np.abs(found - 0.5 - block_view(given.block, name).project(GROUND)).max() < 0.15
    assert "2100" in root.find(".//reference").text


@pytest.mark.parametrize("camera", [BROWN, SKEW])
def test_pix4d_sees_the_ground_where_we_do(camera):
    given = project(camera)
    files = {name: text.decode() for name, text in texts(given, "pix4d").items()}
    offset = np.array([float(v) for v in files["site_offset.xyz"].split()])
    blocks = files["site_calibrated_camera_parameters.txt"].split("\n\n", 1)[1].splitlines()
    matrices = [line.split() for line in files["site_pmatrix.txt"].splitlines()]
    external = [line.split() for line in files["site_calibrated_external_camera_parameters.txt"].splitlines()[1:]]
    for k, (first, _) in enumerate(pairwise(range(0, len(blocks) + 1, 10))):
        name, rows = given.block.names[k], [[float(v) for v in line.split()] for line in blocks[first + 1 : first + 10]]
        K, (k1, k2, k3), (t1, t2), t, R = np.array(rows[:3]), rows[3], rows[4], np.array(rows[5]), np.array(rows[6:])
        x, y, z = R @ (GROUND - offset - t).T
        x, y = x / z, y / z
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        xd, yd = x * radial + 2 * t1 * x * y + t2 * (r2 + 2 * x * x), y * radial + 2 * t2 * x * y + t1 * (r2 + 2 * y * y)
        found = (K @ [xd, yd, np.ones_like(xd)])[:2].T
        assert np.abs(found - block_view(given.block, name).project(GROUND)).max() < 1e-3
        u = np.column_stack([GROUND - offset, np.ones(4)]) @ np.reshape([float(v) for v in matrices[k][1:]], (3, 4)).T
        assert np.abs(u[:, :2] / u[:, 2:] - (K @ [x, y, np.ones_like(x)])[:2].T).max() < 1e-3
        assert [float(v) for v in external[k][1:]] == pytest.approx([*CENTRES[k], *ANGLES[k]], abs=1e-6)


@pytest.mark.parametrize("program", ["odm", "metashape", "pix4d"])
def test_a_lens_that_a_program_lacks_is_refused_with_a_way_out(program):
    given = project(BROWN.model_copy(update={"lens": DivisionLens(k1=-0.02)}))
    with pytest.raises(WorkflowError, match=r"lens of the kind division .* \(--as colmap\)"):
        texts(given, program)
    assert "sparse/images.bin" in texts(given, "colmap")


def test_a_block_that_lies_nowhere_is_no_block_for_opendronemap():
    with pytest.raises(WorkflowError, match="needs a place on the earth"):
        texts(project(crs=own_system(scaled=False)), "odm")
