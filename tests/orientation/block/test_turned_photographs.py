"""Photographs that EXIF turned upright share the sensor of the others: the same block, in the frames of upright photographs."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient
from simulated_block import turned_upright, two_strips

from orthomill.schemas.camera import Cameras
from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.camera_change import turned
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.orientation.sensor_frame import Upright

FLAGS = {"s0_1": 6, "s1_0": 8, "s1_2": 3}


@pytest.fixture(scope="module")
def both():
    block = two_strips(41, tracks=500)
    return block, orient(block), orient(turned_upright(block, FLAGS))


def test_the_block_is_the_same_whichever_way_photographs_are_turned(both):
    _, plain, out = both
    assert out["block"].sigma0_px == pytest.approx(plain["block"].sigma0_px, rel=1e-6)
    for name in plain["block"].names:
        one, other = plain["block"].of(name), out["block"].of(name)
        assert np.allclose(one.centre, other.centre, atol=1e-5)
        assert np.allclose(np.array(one.covariance)[:3, :3], np.array(other.covariance)[:3, :3], rtol=1e-4)


def test_a_turned_photograph_sees_ground_where_the_turned_picture_shows_it(both):
    block, plain, out = both
    for photo in turned_upright(block, FLAGS).photos.photos:
        seen = block_view(plain["block"], photo.name).project(block.ground[:50])
        there = block_view(out["block"], photo.name).project(block.ground[:50])
        back = Upright(Photos(photos=(photo,)), out_cameras(photo, out))._to_sensor(photo, there) if photo.name in FLAGS else there
        assert np.allclose(back, seen, atol=1e-3)


def out_cameras(photo, out):
    return Cameras(cameras=out["block"].cameras, of_photo={photo.name: out["block"].of_photo[photo.name]})


def test_cameras_differ_by_their_turn_only_and_go_together(both):
    _, plain, out = both
    cameras = out["block"].cameras
    assert set(cameras) == {"cam", "cam turned 3", "cam turned 6", "cam turned 8"}
    for name, flag in (("cam turned 6", 6), ("cam turned 8", 8), ("cam turned 3", 3)):
        expected = turned(plain["block"].cameras["cam"], flag)
        assert np.allclose(cameras[name].interior, expected.interior, rtol=1e-6, atol=1e-6)
        assert np.allclose(cameras[name].covariance, expected.covariance, rtol=1e-3, atol=1e-12)
    (joint,) = [j for j in out["block"].joint_cameras if {j.first, j.second} == {"cam", "cam turned 3"}]
    assert joint.covariance[0][0] == pytest.approx(cameras["cam"].covariance[0][0])


def test_image_residuals_are_those_in_the_upright_photograph(both):
    block, plain, out = both
    one, other = plain["image_residuals"], out["image_residuals"]
    assert np.allclose(np.hypot(one.v_col, one.v_row), np.hypot(other.v_col, other.v_row), atol=1e-3)
    ties = turned_upright(block, FLAGS).tie_points
    place = {(t, p): (c, r) for t, p, c, r in zip(ties.track, ties.photo, ties.col, ties.row, strict=True)}
    own = other.track >= 0
    seen = np.array([place[t, p] for t, p in zip(other.track[own], other.photo[own], strict=True)])
    assert np.allclose(seen, np.column_stack([other.col, other.row])[own], atol=1e-6)


def test_a_list_made_in_reduced_files_before_exif_turns_them_ties_the_block(both):
    """A public list of a kite's photographs was made in copies of 2400 px that no program had turned."""
    block, plain, _ = both
    listed = tuple(point.model_copy(update={"measurements": reduced(point.measurements, 1.5625)}) for point in block.control.points)
    out = orient(replace(turned_upright(block, FLAGS), control=Control(points=listed)))
    (found,) = (finding for finding in out["precision"].findings if finding.code == "marks_in_another_frame")
    assert found.counted == "in the files as they are before EXIF turns them" and found.factor == pytest.approx(1.5625, rel=1e-3)
    for name in plain["block"].names:
        assert np.allclose(plain["block"].of(name).centre, out["block"].of(name).centre, atol=0.05)


def reduced(marks, factor):
    """Marks in copies that were reduced by a factor."""
    return {name: ((col + 0.5) / factor - 0.5, (row + 0.5) / factor - 0.5, sigma) for name, (col, row, sigma) in marks.items()}


def test_points_of_sensors_come_back_upright():
    block = turned_upright(two_strips(41, tracks=60), FLAGS)
    upright = Upright(block.photos, block.cameras)
    for point in block.control.points:
        back = upright.upright_point(upright.sensor_point(point))
        assert back.measurements.keys() == point.measurements.keys()
        for name, mark in point.measurements.items():
            assert back.measurements[name] == pytest.approx(mark)


def test_angle_covariances_are_those_of_the_upright_angles(both):
    """The standard errors of the attitude, as a rotation vector in the world, do not depend on the turn."""
    from orthomill.tasks.geometry.rotation import rotation_matrix
    from orthomill.tasks.geometry.rotation_vector import angles_from_vector

    _, plain, out = both
    for name in FLAGS:
        sizes = []
        for tables in (plain, out):
            own = tables["block"].of(name)
            R = rotation_matrix(*np.radians(own.omega_phi_kappa))
            by_vector = np.linalg.inv(angles_from_vector(R))
            covariance = R.T @ by_vector @ np.array(own.covariance)[3:, 3:] @ by_vector.T @ R
            sizes.append(covariance)
        assert np.allclose(*sizes, rtol=1e-3, atol=1e-14)
