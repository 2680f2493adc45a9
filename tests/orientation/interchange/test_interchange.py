"""Orientations of other programs: every format there and back, and the conventions by independent projection formulas."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from orienting import orient, sentences
from simulated_block import TRUE_CAMERA, two_strips

from orthomill.schemas.camera import BrownLens, Camera, FisheyeLens, RationalLens
from orthomill.schemas.errors import GeometryError, WorkflowError
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.geometry.rotation_quaternion import quaternion
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.geometry.topocentric import Reference, Topocentric
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.orientation.exterior.fixed_block import orient_fixed
from orthomill.tasks.orientation.interchange.angles_csv import read_angles
from orthomill.tasks.orientation.interchange.colmap import read_colmap
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock, ForeignPose, file_view, upright_block
from orthomill.tasks.orientation.interchange.opensfm import read_opensfm
from orthomill.tasks.orientation.orientation_settings import FromAngles, FromColmap, FromOpensfm
from orthomill.tasks.orientation.report.block_report import report
from orthomill.tasks.orientation.results.products import block_products
from orthomill.tasks.orientation.start.georeference import own_system

CRS = "EPSG:2100"
COLMAP = FromColmap(kind="colmap", cameras_path="c", images_path="i", points_path="p", placed="project")
OPENSFM = FromOpensfm(kind="opensfm", path="r")
ANGLES = FromAngles(kind="csv", path="a")


@pytest.fixture(scope="module")
def products(volos_like):
    block, result = volos_like
    return {name: text.text for name, text in block_products(block.photos, result["block"], result["points"]).items()}


def texts_of(products, source):
    names = {
        "colmap": ("cameras.txt", "images.txt", "points3D.txt"),
        "opensfm": ("reconstruction.json",),
        "csv": ("exterior_orientation.csv",),
    }
    return tuple(products[name] for name in names[source.kind])


@pytest.mark.parametrize("source", [COLMAP, OPENSFM, ANGLES], ids=lambda source: source.kind)
def test_what_leaves_comes_back_the_same(volos_like, products, source):
    block, result = volos_like
    cameras = block.cameras.model_copy(update={"cameras": result["block"].cameras})
    tables = orient_fixed(block.photos, cameras, block.control, texts_of(products, source), source, CRS, block.tie_points)
    ground = block.ground[:200]
    for name in result["block"].names:
        before, after = block_view(result["block"], name), block_view(tables.block, name)
        rounding = 5e-8 if source.kind == "opensfm" else 5e-9, "OpenSfM's numbers go through geocentric coordinates of 6 000 km"
        assert np.abs(after.centre - before.centre).max() < rounding[0], rounding[1]
        assert np.abs(after.rotation - before.rotation).max() < 1e-9
        assert np.nanmax(np.abs(after.project(ground) - before.project(ground))) < 1e-6


@pytest.mark.parametrize("source", [COLMAP, OPENSFM, ANGLES], ids=lambda source: source.kind)
def test_own_tie_points_examine_a_fixed_block(volos_like, products, source):
    block, result = volos_like
    cameras = block.cameras.model_copy(update={"cameras": result["block"].cameras})
    tables = orient_fixed(block.photos, cameras, block.control, texts_of(products, source), source, CRS, block.tie_points)
    own = result["image_residuals"].take(result["image_residuals"].used & (result["image_residuals"].track >= 0))
    rms = np.sqrt(np.mean(np.concatenate([own.v_col, own.v_row]) ** 2))
    assert tables.block.sigma0_px == pytest.approx(rms, rel=0.03)
    check = [point for point in tables.ground_residuals.points if point.role == "check"]
    assert len(check) == 8 and all(np.abs(point.difference).max() < 1.0 for point in check)
    empty = SimpleNamespace(pairs=())
    page = report(
        block.photos,
        cameras,
        block.control,
        empty,
        tables.block,
        tables.points,
        tables.image_residuals,
        tables.ground_residuals,
        tables.precision,
    )
    assert next(figure.value for figure in page.figures if figure.name == "photos_oriented") == 6


def test_without_tie_points_the_programs_own_points_tell_the_height(volos_like, products):
    block, result = volos_like
    tables = orient_fixed(block.photos, block.cameras, block.control, texts_of(products, COLMAP), COLMAP, CRS)
    assert tables.block.ground_low == pytest.approx(result["block"].ground_low, abs=0.5)
    assert len(tables.image_residuals) == len(tables.points) == 0
    page = report(block.photos, block.cameras, block.control, SimpleNamespace(pairs=()), *tables[:5])
    assert next(figure.value for figure in page.figures if figure.name == "sigma0_px") is None
    assert any("No tie points of the project examine" in text for text in page.warnings)
    assert not any("Weakly tied" in text for text in page.warnings)
    with pytest.raises(GeometryError, match="Nothing determines the height of the ground"):
        orient_fixed(block.photos, block.cameras, block.control, texts_of(products, ANGLES), ANGLES, CRS)
    given = ANGLES.model_copy(update={"ground": (90.0, 150.0)})
    tables = orient_fixed(block.photos, block.cameras, block.control, texts_of(products, ANGLES), given, CRS)
    assert (tables.block.ground_low, tables.block.ground_high) == (90.0, 150.0)


def test_a_block_without_a_place_on_earth_leaves_in_its_own_coordinates(volos_like):
    block, result = volos_like
    lost = result["block"].model_copy(update={"crs": own_system(scaled=False)})
    (found,) = json.loads(block_products(block.photos, lost, result["points"])["reconstruction.json"].text)
    assert "reference_lla" not in found
    centres = {photo.photo: photo.centre for photo in lost.photos}
    assert {tuple(shot["gps_position"]) for shot in found["shots"].values()} == set(centres.values())


def test_a_model_in_a_system_of_its_own_is_placed_by_positions(volos_like, products):
    """COLMAP's usual model: any place, direction and scale."""
    block, _ = volos_like
    turn, shift = rotation_of_vector(np.array([0.4, -1.1, 2.0])), np.array([3.0, -4.0, 0.5])
    lines = []
    foreign = read_colmap(*texts_of(products, COLMAP))
    origin = np.array([407500.0, 4357300.0, 0.0])
    for line in products["images.txt"].splitlines()[1:]:
        words = line.split()
        if words:
            pose = foreign.poses[photo_stem(words[9])]
            R = np.diag([1.0, -1.0, -1.0]) @ pose.rotation @ turn.T
            centre = turn @ (pose.centre - origin) / 500.0 + shift
            numbers = " ".join(repr(float(v)) for v in (*quaternion(R), *(-R @ centre)))
            lines.append(f"{words[0]} {numbers} {words[8]} {words[9]}\n0.5 0.5 -1")
    source = COLMAP.model_copy(update={"placed": "positions", "points_path": None})
    texts = (products["cameras.txt"], "\n".join(lines))
    tables = orient_fixed(block.photos, block.cameras, block.control, texts, source, CRS, block.tie_points)
    truth = np.array([view.centre for view in block.views])
    assert np.abs(np.array([photo.centre for photo in tables.block.photos]) - truth).max() < 0.5
    assert "placed by 6 positions" in tables.block.datum


def test_colmap_pixels_begin_at_the_corner():
    """COLMAP's own formula: the pixel of a point by fx, cx and OpenCV's lens, half a pixel away from ours."""
    cameras = "1 OPENCV 640 480 500 500 330.2 236.4 -0.1 0.02 0.001 -0.002\n"
    images = "1 1 0 0 0 0.1 -0.2 0.3 1 sub/a.JPG\n\n"
    block = read_colmap(cameras, images)
    point = np.array([[0.3, -0.25, 2.0]])
    x, y = (point[0, :2] + [0.1, -0.2]) / (2.3, 2.3)
    r2 = x * x + y * y
    radial = 1 - 0.1 * r2 + 0.02 * r2**2
    u = 500 * (x * radial + 2 * 0.001 * x * y - 0.002 * (r2 + 2 * x * x)) + 330.2
    v = 500 * (y * radial + 0.001 * (r2 + 2 * y * y) + 2 * -0.002 * x * y) + 236.4
    pose = block.poses["a"]
    assert np.allclose(View("a", block.cameras["a"], pose.rotation, pose.centre).project(point), [[u - 0.5, v - 0.5]], atol=1e-9)


def test_opensfm_counts_from_the_centre_in_units_of_the_longer_side():
    camera = {
        "projection_type": "brown",
        "width": 640,
        "height": 480,
        "focal_x": 0.8,
        "focal_y": 0.8,
        "c_x": 0.01,
        "c_y": -0.02,
        "k1": -0.1,
        "k2": 0.02,
        "k3": 0.003,
        "p1": 0.001,
        "p2": -0.002,
    }
    shot = {"camera": "v2", "rotation": [0.1, 0.2, 0.3], "translation": [1.0, 2.0, 30.0]}
    text = json.dumps(
        [
            {
                "cameras": {"v2": camera},
                "shots": {"a.jpg": shot},
                "reference_lla": {"latitude": 39.36, "longitude": 22.94, "altitude": 10.0},
            }
        ]
    )
    block = read_opensfm(text, CRS)
    enu = np.array([[4.0, -5.0, 6.0]])
    p = rotation_of_vector(np.array([0.1, 0.2, 0.3])) @ enu[0] + [1.0, 2.0, 30.0]
    x, y = p[:2] / p[2]
    r2 = x * x + y * y
    radial = 1 + r2 * (-0.1 + r2 * (0.02 + r2 * 0.003))
    u = 0.8 * (x * radial + 2 * 0.001 * x * y - 0.002 * (r2 + 2 * x * x)) + 0.01
    v = 0.8 * (y * radial + 0.001 * (r2 + 2 * y * y) + 2 * -0.002 * x * y) - 0.02
    frame = Topocentric(Reference(39.36, 22.94, 10.0), CRS)
    pose = block.poses["a"]
    found = View("a", block.cameras["a"], pose.rotation, pose.centre).project(frame.to_map(enu))
    assert np.allclose(found, [[640 * u + 319.5, 640 * v + 239.5]], atol=0.02), "the map's scale moves it by some hundredths"


def test_topocentric_there_and_back():
    frame = Topocentric(Reference(39.36, 22.94, 10.0), CRS)
    points = np.array([[0.0, 0.0, 0.0], [500.0, -300.0, 80.0], [-2000.0, 900.0, -5.0]])
    assert np.allclose(frame.from_map(frame.to_map(points)), points, atol=1e-6)
    assert np.allclose(frame.turn(points[1]) @ frame.turn(points[1]).T, np.eye(3), atol=1e-12)
    assert frame.turn(points[0])[2, 2] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_photographs_that_exif_turns_leave_as_their_files_are(orientation):
    """The file's pixel of a ground point, and the upright one, are the same place of the picture."""
    sides = (480, 640) if orientation in (6, 8) else (640, 480)
    size = {"width": sides[0], "height": sides[1]}
    photo = Photo(name="a", path="a.jpg", bands=3, dtype="uint8", exif_orientation=orientation, camera="c", **size)
    camera = Camera(name="c", c=500.0, x0=4.0, y0=-7.0, k1=-0.1, p1=1e-3, p2=-2e-3, **size)
    pose = ForeignPose(rotation_matrix(0.02, -0.03, 0.5), np.array([10.0, 20.0, 100.0]))
    in_file, file_pose = file_view(photo, camera, pose)
    assert (in_file.width, in_file.height) == (640, 480)
    ground = np.array([[12.0, 24.0, 3.0]])
    ((col, row),) = View("a", camera, pose.rotation, pose.centre).project(ground)
    ((file_col, file_row),) = View("a", in_file, file_pose.rotation, file_pose.centre).project(ground)
    upright = {
        1: (file_col, file_row),
        3: (639 - file_col, 479 - file_row),
        6: (479 - file_row, file_col),
        8: (file_row, 639 - file_col),
    }
    assert np.allclose(upright[orientation], (col, row), atol=1e-8)
    back = upright_block(ForeignBlock({"a": file_pose}, {"a": in_file}, np.zeros((0, 3))), Photos(photos=(photo,)))
    assert np.allclose(back.poses["a"].rotation, pose.rotation) and back.cameras["a"].interior == pytest.approx(camera.interior)


def test_seven_columns_without_a_header_are_angles():
    block = read_angles("# a comment\nleft 1 2 3 0.1 0.2 90\nright.tif 2 2 3 0 0 90\n")
    assert list(block.poses) == ["left", "right"]
    assert np.allclose(block.poses["right"].rotation, rotation_matrix(0, 0, np.pi / 2))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("photo,x,y,z,omega,phi\na,1,2,3,4,5\n", r"lacks the column\(s\) kappa"),
        ("photo,x,y,z,omega,phi,kappa\na,1,2,3,4,5,six\n", "Line 2 .* six numbers"),
        ("photo,x,y,z,omega,phi,kappa\na.jpg,1,2,3,4,5,6\na,1,2,3,4,5,6\n", "Line 3 .* names the photograph a a second time"),
        ("", "lacks the column"),
    ],
)
def test_a_wrong_table_of_angles_is_told(text, sentence):
    with pytest.raises(WorkflowError, match=sentence):
        read_angles(text)


def test_lenses_that_cannot_be_carried_over_are_refused():
    with pytest.raises(WorkflowError, match="of the model FOV; models that can be read are"):
        read_colmap("1 FOV 640 480 1 1 1 1 0\n", "")
    with pytest.raises(WorkflowError, match="fisheye"):
        read_opensfm('[{"cameras": {"v": {"projection_type": "fisheye", "width": 1, "height": 1}}, "shots": {}}]', CRS)
    with pytest.raises(WorkflowError, match=r"not a reconstruction\.json"):
        read_opensfm('{"type": "FeatureCollection"}', CRS)


@pytest.mark.parametrize(
    ("line", "lens"),
    [
        ("1 PINHOLE 640 480 500 501 320 240", BrownLens()),
        (
            "1 FULL_OPENCV 640 480 500 501 320 240 0.1 0.2 0.01 0.02 0 0.3 0 0.4",
            RationalLens(k1=0.1, k2=0.2, p1=0.01, p2=0.02, k4=0.3, k6=0.4),
        ),
        ("1 OPENCV_FISHEYE 640 480 500 501 320 240 0.1 0.2 0.3 0.4", FisheyeLens(k1=0.1, k2=0.2, k3=0.3, k4=0.4)),
    ],
)
def test_lenses_of_colmap_are_read(line, lens):
    camera = read_colmap(line + "\n", "1 1 0 0 0 0 0 0 1 a\n").cameras["a"]
    assert camera.lens == lens and camera.c == 501.0 and camera.c * (1.0 + camera.affinity) == pytest.approx(500.0)


def test_a_block_of_other_photographs_is_told(volos_like):
    block, _ = volos_like
    with pytest.raises(WorkflowError, match="None of the 6 photographs of the project"):
        orient_fixed(block.photos, block.cameras, block.control, ("zz 1 2 3 0 0 0\n",), ANGLES, CRS, block.tie_points)


def fixed_tables(block, change=lambda i: 0.0, name=lambda name: name):
    """The tables of a fixed block whose CSV has X, Y, Z, omega, phi, kappa changed by `change(number)`."""
    text = "photo,x,y,z,omega,phi,kappa\n"
    for i, view in enumerate(block.views):
        pose = np.array([*view.centre, *np.degrees(angles(view.rotation))]) + change(i)
        text += ",".join((name(view.name), *(repr(float(v)) for v in pose))) + "\n"
    cameras = block.cameras.model_copy(update={"cameras": {"cam": TRUE_CAMERA}})
    return orient_fixed(block.photos, cameras, block.control, (text,), ANGLES, CRS, block.tie_points)


def test_photographs_that_only_one_of_the_two_has_are_named():
    block = two_strips(4)
    tables = fixed_tables(block, name=lambda name: {"s0_0": "Z9"}.get(name, f"photos/{name.upper()}.JPG"))
    assert len(tables.block.photos) == 5 and sentences(tables.precision)[-1].endswith("which the project does not have: Z9.")
    assert [one.photo for one in tables.block.unoriented] == ["s0_0"]
    assert len(sentences(tables.precision)) == 1


def test_a_foreign_block_of_another_system_is_told():
    block = two_strips(4)
    tables = fixed_tables(block, lambda i: [0.0, 0.0, 43.0, 0.0, 0.0, 0.0])
    assert any("elsewhere" in text and "+43." in text for text in sentences(tables.precision))


def test_a_foreign_block_that_the_tie_points_contradict_is_told():
    block = two_strips(4)
    tables = fixed_tables(block, lambda i: [0.0, 0.0, 0.0, 2.0 * (i % 2), 0.0, 0.0])
    assert any("tie points miss the orientation" in text for text in sentences(tables.precision))


def test_a_foreign_block_whose_rays_part_is_told():
    with pytest.raises(GeometryError, match=r"rays of the .* do not meet in front of the photographs as a orients them"):
        fixed_tables(two_strips(4), lambda i: [0.0, 0.0, 0.0, 0.0, 0.0, 180.0])


def test_a_slightly_wrong_foreign_orientation_shows_in_the_residuals():
    block = two_strips(4)
    tables = fixed_tables(block, lambda i: [0.0, 0.0, 0.0, 0.05 * (i % 2), 0.0, 0.0])
    own = orient(block)["block"].sigma0_px
    assert tables.block.sigma0_px > 1.5 * own


def test_a_camera_of_the_scan_itself_does_not_fit_its_frame():
    scan = Photo(
        name="a",
        path="a.tif",
        width=201,
        height=201,
        bands=1,
        dtype="uint8",
        camera="s",
        scan=(0, 1, 0, 0, 0, 1),
        scan_size=(240, 240),
    )
    camera = Camera(name="s", width=240, height=240, c=300.0)
    with pytest.raises(WorkflowError, match="a is a scan that was put into a frame of 201 x 201 pixels"):
        upright_block(
            ForeignBlock({"a": ForeignPose(np.eye(3), np.zeros(3))}, {"a": camera}, np.zeros((0, 3))), Photos(photos=(scan,))
        )
