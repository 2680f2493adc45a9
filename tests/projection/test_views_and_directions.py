"""Views by target, angles or matrix, of any lens; oblique parallel projections; the orthoimage of one photograph."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from orthomill.schemas.camera import FisheyeLens
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.solid.frames import FlatFrame, ViewFrame
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.projection.frames.projection_frames import looking_at, output_frames
from orthomill.tasks.projection.mesh.mesh_mending import mend_mesh
from orthomill.tasks.projection.outputs import Output
from orthomill.tasks.visibility.output_frame import pixel_rays, plane_projection, shown_points
from tests.support.solid import wall_and_box as scene

VIEW = {"kind": "perspective", "name": "view", "position": (1.0, -4.0, 2.0)}
WALL = {"kind": "plane", "name": "front", "plane": {"kind": "normal", "point": (0, 0, 1), "normal": (0, -1, 0)}}
POSITION, TARGET = np.array([1.0, -4.0, 2.0]), np.array([0.0, 0.0, 1.4])
NOWHERE = np.zeros(3)


def framed(output: dict[str, Any]):
    mended, block = mend_mesh(scene.mesh(), "auto", (0.0, 0.0, 0.0)), scene.block()
    outputs = (TypeAdapter(Output).validate_python(output),)
    return output_frames(mended.vertices, mended.triangles, mended.census, block, outputs, block.names, "auto").frames[0]


def rotation_of(**how) -> np.ndarray:
    frame = framed({**VIEW, **how})
    assert isinstance(frame, ViewFrame)
    return rotation_matrix(*np.radians(frame.omega_phi_kappa))


def test_a_view_is_turned_by_target_and_roll_by_angles_or_by_a_matrix():
    upright = rotation_of(target=tuple(TARGET))
    np.testing.assert_allclose(upright, looking_at(POSITION, TARGET), atol=1e-9)
    rolled = rotation_of(target=tuple(TARGET), roll=30.0)
    np.testing.assert_allclose(rolled[2], upright[2], atol=1e-9, err_msg="it still looks at its target")
    # A camera turned clockwise sees upright things turned counter-clockwise: up in the world is to the left in the picture.
    up = rolled @ [0.0, 0.0, 1.0]
    assert np.degrees(np.arctan2(-up[0], up[1])) == pytest.approx(30.0, abs=0.5)
    np.testing.assert_allclose(
        rotation_of(omega_phi_kappa=(80.0, 10.0, -5.0)), rotation_matrix(*np.radians((80, 10, -5))), atol=1e-9
    )
    np.testing.assert_allclose(rotation_of(rotation=tuple(map(tuple, rolled.tolist()))), rolled, atol=1e-9)


def test_a_view_has_any_lens_and_a_principal_point():
    frame = framed({**VIEW, "target": tuple(TARGET), "lens": "fisheye", "k1": 0.02, "x0": 3.0, "y0": -2.0})
    assert frame.camera.lens == FisheyeLens(k1=0.02) and (frame.camera.x0, frame.camera.y0) == (3.0, -2.0)


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({}, "needs either a target, or omega_phi_kappa, or a rotation; there is none"),
        ({"target": (0, 0, 0), "omega_phi_kappa": (0, 0, 0)}, "there is target and omega_phi_kappa"),
        ({"omega_phi_kappa": (0, 0, 0), "roll": 5.0}, "roll has no effect"),
        ({"rotation": ((1, 0, 0), (0, 1, 0), (0, 0, -1))}, "no rotation matrix"),
        ({"rotation": ((2, 0, 0), (0, 1, 0), (0, 0, 1))}, "no rotation matrix"),
        ({"target": (0, 0, 0), "lens": "division", "k2": 0.1}, "a lens of kind division has no k2"),
    ],
)
def test_a_view_that_says_too_little_or_too_much_is_refused(how, says):
    with pytest.raises(ValidationError, match=says):
        TypeAdapter(Output).validate_python({**VIEW, **how})


def test_points_along_an_oblique_ray_are_at_one_pixel_and_come_back_from_it():
    frame = framed({**WALL, "towards": (0.4, -1.0, 0.5), "pixel": 0.01, "size": (3.0, 2.0)})
    assert isinstance(frame, FlatFrame)
    towards = np.array([0.4, -1.0, 0.5]) / np.linalg.norm([0.4, -1.0, 0.5])
    pixels = np.random.default_rng(3).uniform(0, 150, (40, 2))
    nearness = np.random.default_rng(4).uniform(-0.5, 1.5, 40)
    points = shown_points(frame, pixels, nearness, NOWHERE)
    rays = pixel_rays(frame, pixels, NOWHERE)
    np.testing.assert_allclose(rays.start[:, 1], 0.0, atol=1e-9, err_msg="rays begin on the plane")
    np.testing.assert_allclose(points, rays.start + nearness[:, None] * towards, atol=1e-9)
    back = plane_projection(frame, NOWHERE).matrix @ np.column_stack([points, np.ones(40)]).T
    np.testing.assert_allclose(back.T, np.column_stack([pixels, nearness]), atol=1e-6)
    assert "PLANE_TOWARDS" in frame.tags and "PLANE_TOWARDS" not in framed(WALL).tags


def test_an_oblique_picture_holds_what_is_seen_and_a_direction_along_the_plane_is_refused():
    straight, oblique = framed({**WALL, "pixel": 0.02}), framed({**WALL, "towards": (0.5, -1.0, 0.0), "pixel": 0.02})
    # The box stands out from the wall, and beside itself in the oblique picture; the wall is as wide in both.
    assert oblique.cols >= straight.cols and oblique.rows == straight.rows
    for wrong in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)):
        with pytest.raises(GeometryError, match="does not lead in front of its plane"):
            framed({**WALL, "towards": wrong})


def test_an_orthoimage_of_one_photograph_leaves_out_the_others():
    others = tuple(name for name in scene.block().names if name != "b")
    assert framed({**WALL, "only": "b"}).without == others == framed({"kind": "map", "only": "b"}).without
    assert framed(WALL).without == ()
    with pytest.raises(GeometryError, match="'z' of the output 'front' is not oriented"):
        framed({**WALL, "only": "z"})
