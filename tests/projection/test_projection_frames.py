"""Where outputs lie, how large and fine they are, and a sentence for each that would be empty."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.solid.frames import FlatFrame, ViewFrame
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.imagery.pyramid import full_to_level
from orthomill.tasks.projection.frames.projection_frames import halved, output_frames, round_pixel
from orthomill.tasks.projection.mesh.mesh_mending import mend_mesh
from orthomill.tasks.projection.outputs import Output
from orthomill.tasks.projection.stage import ProjectionStage
from tests.support.solid import wall_and_box as scene


def framed(output: dict[str, Any], mesh: TriangleMesh | None = None, block=None, unit="auto"):
    mended = mend_mesh(mesh or scene.mesh(), unit, (0.0, 0.0, 0.0))
    outputs = (TypeAdapter(Output).validate_python(output),)
    oriented = block or scene.block()
    return output_frames(mended.vertices, mended.triangles, mended.census, oriented, outputs, oriented.names, unit).frames[0]


PLANE = {"kind": "plane", "name": "front"}


def flat(plane: dict[str, Any], **more) -> FlatFrame:
    frame = framed({**PLANE, "plane": plane, **more})
    assert isinstance(frame, FlatFrame)
    return frame


@pytest.mark.parametrize(
    "plane",
    [
        {"kind": "facade"},
        {"kind": "edge", "left": (-1.0, 0.0, 0.5), "right": (1.0, 0.0, 0.5)},
        {"kind": "normal", "point": (0.0, 0.0, 1.0), "normal": (0.0, -3.0, 0.0)},
        {"kind": "points", "points": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))},
    ],
    ids=lambda plane: plane["kind"],
)
def test_every_way_to_give_a_wall_sees_it_upright_from_the_photographs(plane):
    frame = flat(plane)
    np.testing.assert_allclose(frame.normal, (0, -1, 0), atol=1e-9)
    np.testing.assert_allclose(frame.right, (1, 0, 0), atol=1e-9)
    np.testing.assert_allclose(frame.up, (0, 0, 1), atol=1e-9)
    # The whole wall, 4 m x 3 m, and the pixel of the photographs on it: 5 m / 200 px, as a round number.
    assert frame.pixel == 0.02
    assert abs(frame.cols * frame.pixel - 4.0) < 0.1 and abs(frame.rows * frame.pixel - 3.0) < 0.1


@pytest.mark.parametrize("kind", ["facade", "fit"])
def test_a_wall_that_is_found_has_its_upper_end_where_the_photographs_have_theirs(kind):
    """A system whose Z points downwards: everything turned about the line of sight, photographs and surface."""
    block, mesh = scene.block(), scene.mesh()
    turn = np.diag([-1.0, 1.0, -1.0])
    poses = []
    for pose in block.photos:
        view = block_view(block, pose.photo)
        turned = np.degrees(angles(view.rotation @ turn.T))
        place = tuple(map(float, turn @ view.centre))
        poses.append(pose.model_copy(update={"centre": place, "omega_phi_kappa": tuple(map(float, turned))}))
    upset = TriangleMesh(mesh.vertices @ turn.T, mesh.triangles)
    frame = framed({**PLANE, "plane": {"kind": kind}}, upset, block.model_copy(update={"photos": tuple(poses)}))
    usual = flat({"kind": kind})
    for axis in ("right", "up", "normal"):
        np.testing.assert_allclose(getattr(frame, axis), turn @ getattr(usual, axis), atol=1e-6)
    assert frame.shape == usual.shape
    # A direction that is stated is not examined.
    assert framed({**PLANE, "plane": {"kind": "normal", "point": (0, 0, -1), "normal": (0, -1, 0)}}, upset).up == (0.0, 0.0, 1.0)


def test_the_best_plane_of_a_part_is_that_of_the_part():
    side = flat({"kind": "fit", "low": (-9, -0.01, -9), "high": (9, 0.01, 9)})
    np.testing.assert_allclose(np.abs(side.normal), (0, 1, 0), atol=1e-6)
    with pytest.raises(GeometryError, match="No surface lies between"):
        flat({"kind": "fit", "low": (50, 50, 50), "high": (51, 51, 51)})


def test_a_turned_facade_is_found_to_the_nearest_degree():
    turn = np.radians(33.3)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    mesh = scene.mesh()
    positions = tuple(tuple(map(float, rotation @ place)) for place in scene.POSITIONS)
    frame = framed({**PLANE}, TriangleMesh(mesh.vertices @ rotation.T, mesh.triangles), scene.block(positions))
    assert np.degrees(np.arctan2(frame.right[1], frame.right[0])) == pytest.approx(33.0, abs=1e-6)


def test_two_millimetres_of_an_area_are_so_many_pixels_and_so_much_paper(record_property):
    frame = flat({"kind": "facade"}, pixel=0.002, size=(3.0, 2.0))
    record_property("found", f"{frame.cols} x {frame.rows} px, {frame.tags['PAPER_SCALE_AT_0.1_MM']}")
    assert frame.shape == (1000, 1500)
    assert frame.tags["PAPER_SCALE_AT_0.1_MM"] == "1:20"
    assert frame.tags["PLANE_NORMAL"].split()[1] == "-1"


def test_a_map_lies_on_multiples_of_its_pixel():
    frame = framed({"kind": "map", "pixel": 0.3})
    assert frame.grid.west / 0.3 == pytest.approx(round(frame.grid.west / 0.3), abs=1e-9)
    assert frame.grid.north / 0.3 == pytest.approx(round(frame.grid.north / 0.3), abs=1e-9)


def test_pixels_are_round_numbers():
    assert [round_pixel(size) for size in (0.0026, 0.0101, 0.09, 0.7)] == pytest.approx([0.002, 0.01, 0.1, 0.5])


def test_a_halved_camera_shows_what_the_level_shows():
    point = scene.block().cameras["cam"]
    view = ViewFrame(name="v", rows=1, cols=1, camera=point, omega_phi_kappa=(90.0, 0.0, 0.0), centre=(0.0, -5.0, 1.0))
    from orthomill.tasks.geometry.view import View

    place, rotation = np.array([[0.7, 0.1, 1.9]]), rotation_matrix(*np.radians(view.omega_phi_kappa))
    full = View("v", point, rotation, np.array(view.centre)).project(place)
    level = View("v", halved(point, 2), rotation, np.array(view.centre)).project(place)
    np.testing.assert_allclose(level, full_to_level(full, 2), atol=1e-9)


def speck() -> TriangleMesh:
    """One triangle of five centimetres in the middle of the photographs."""
    return TriangleMesh(np.array([[-0.02, 0, 1.5], [0.02, 0, 1.5], [0, 0, 1.53]]), np.array([[0, 1, 2]], np.int32))


def scaled(factor: float, shift=(0.0, 0.0, 0.0)) -> TriangleMesh:
    mesh = scene.mesh()
    return TriangleMesh(mesh.vertices * factor + shift, mesh.triangles)


@pytest.mark.parametrize(
    ("output", "mesh", "words"),
    [
        (PLANE, scaled(1.0, (0.0, 0.0, 60.0)), "None of the surface is in the frame of any of the 4 photographs"),
        (PLANE, scaled(1.0, (0.0, 10_000.0, 0.0)), r"fills no more than 0.1 pixels .* lies 1000\d m from theirs.*far behind what"),
        (PLANE, scaled(1.0, (10_000.0, 0.0, 0.0)), "its middle lies 10000 m from theirs, which are 4.8"),
        (PLANE, scaled(0.01, (0.0, 0.0, 1.4)), "fills no more than 2 pixels .* Give its `unit`"),
        (PLANE, speck(), r"The surface \(one triangle\) fills no more than 1.9 pixels"),
        (PLANE, scaled(1.0, (0.0, -200.0, 0.0)), "its middle lies 19.* m from theirs, .* different systems"),
        (
            {**PLANE, "plane": {"kind": "normal", "point": (0, 0, 0), "normal": (0, 0, 0.0001)}, "pixel": 1e-6},
            None,
            "pixels; give a",
        ),
        ({**PLANE, "plane": {"kind": "points", "points": ((0, 0, 0), (1, 1, 1), (2, 2, 2))}}, None, "lie on a line"),
        ({**PLANE, "plane": {"kind": "edge", "left": (0, 0, 0), "right": (0, 0, 1)}}, None, "is upright or a point"),
        ({"kind": "photograph", "photo": "z"}, None, "'z' of the output 'photograph' is not oriented; there are a, b"),
        ({"kind": "perspective", "position": (1, 1, 1), "target": (1, 1, 1)}, None, "looks at its own position"),
        ({"kind": "cylinder", "foot": (0, 0, 0), "head": (0, 0, 0), "radius": 1.0}, None, "ends of the axis"),
    ],
)
def test_what_would_be_empty_is_a_sentence(output, mesh, words):
    with pytest.raises(GeometryError, match=words):
        framed(output, mesh)


def round_about() -> tuple[TriangleMesh, Any]:
    """A ball of half a metre and four photographs 3 m from it, all round."""
    turn, tilt = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0.01, np.pi - 0.01, 13))
    x, y, z = np.cos(turn) * np.sin(tilt), np.sin(turn) * np.sin(tilt), np.cos(tilt)
    i = np.arange(x.size).reshape(x.shape)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel()
    triangles = np.vstack([np.column_stack([a, c, b]), np.column_stack([b, c, d])]).astype(np.int32)
    ball = TriangleMesh(0.5 * np.column_stack([x.ravel(), y.ravel(), z.ravel()]) + [0, -0.3, 1.4], triangles)
    return ball, scene.block(((3.0, -0.3, 1.4), (-3.0, -0.3, 1.4), (0.0, 2.7, 1.4), (0.0, -3.3, 1.4)))


def test_millimetres_taken_for_metres_are_recognised_although_the_photographs_show_some_of_it():
    ball, block = round_about()
    huge = TriangleMesh(ball.vertices * 1000.0, ball.triangles)
    with pytest.raises(GeometryError, match="In mm it would fit: set `unit: mm`"):
        framed(PLANE, huge, block, unit="auto")
    assert framed(PLANE, huge, block, unit="mm").pixel < 0.03
    with pytest.raises(GeometryError, match="1000 times smaller: is `unit: m` right"):
        framed(PLANE, TriangleMesh(scene.mesh().vertices * 1000.0, scene.mesh().triangles), unit="m")
    assert framed(PLANE, ball, block, unit="auto").pixel < 0.03
    tiny = TriangleMesh(scene.mesh().vertices / 100.0, scene.mesh().triangles)
    with pytest.raises(GeometryError, match="It would fit 100 times larger: is `unit: cm` right"):
        framed(PLANE, tiny, unit="cm")


def test_photographs_that_all_look_away_are_a_sentence():
    ball, block = round_about()
    turned = tuple(
        pose.model_copy(
            update={
                "omega_phi_kappa": tuple(
                    map(float, np.degrees(angles(np.diag([-1.0, 1, -1]) @ rotation_matrix(*np.radians(pose.omega_phi_kappa)))))
                )
            }
        )
        for pose in block.photos
    )
    with pytest.raises(GeometryError, match="photographs look away from it"):
        framed(PLANE, ball, block.model_copy(update={"photos": turned}))


def test_a_plane_edge_on_is_a_sentence():
    wall = TriangleMesh(np.array([[-2.0, 0, 0], [2, 0, 0], [2, 0, 3], [-2, 0, 3]]), np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    with pytest.raises(
        GeometryError, match=r"edge-on: .* \(1.00, 0.00, 0.00\) by 0.0 degrees .* faces \(0.00, -1.00, 0.00\): give that"
    ):
        framed({**PLANE, "plane": {"kind": "normal", "point": (0, 0, 0), "normal": (1, 0, 0)}}, wall)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"outputs": [{"kind": "map"}, {"kind": "map"}]}, "map is the name of several outputs"),
        ({"outputs": [{**PLANE, "plane": {"kind": "normal", "point": (0, 0, 0), "normal": (0, 0, 0)}}]}, "towards the viewer"),
        ({"outputs": [{"kind": "map", "section": {"kind": "plane", "point": (0, 0, 0), "normal": (0, 0, 0)}}]}, "cut away"),
    ],
)
def test_settings_without_a_meaning_are_refused(given, words):
    with pytest.raises(ValueError, match=words):
        ProjectionStage.model_validate({"surface": {"kind": "mesh", "path": "a.ply"}, **given})
