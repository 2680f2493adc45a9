"""Covariances of points against errors of orientations that are known to be common, or apart."""

import numpy as np
import pytest
from village_pair import block_of, normal_case

from orthomill.schemas.orientation import JointCovariance
from orthomill.tasks.accuracy.adjustment.joint_covariance import StoredCovariance
from orthomill.tasks.geometry.view import block_view

COMMON = np.diag([0.04, 0.09, 0.01, 0.0, 0.0, 0.0])
"""all photographs are shifted together: m2"""


def block(joint=True):
    """A pair of photographs whose centres err together."""
    found = block_of(normal_case(420))
    rows = tuple(map(tuple, COMMON))
    photos = tuple(photo.model_copy(update={"covariance": rows}) for photo in found.photos)
    first, second = found.names[:2]
    together = (JointCovariance(first=first, second=second, covariance=rows),) if joint else ()
    return found.model_copy(update={"photos": photos, "joint": together})


def places(found):
    """Two points that both photographs show."""
    left, right = (block_view(found, name) for name in found.names[:2])
    middle = 0.5 * (left.camera.width - 1), 0.5 * (left.camera.height - 1)
    pixels = np.array(middle) + np.array([[10.0, 20.0], [25.0, -15.0]])
    ground = left.at_height(pixels, 0.0)
    inside = right.contains(right.project(ground))
    assert inside.all()
    return ground


def test_points_move_with_what_moves_all_photographs():
    found = block()
    known = StoredCovariance(found, 0.0)
    first, second = (known.rays(place) for place in places(found))
    np.testing.assert_allclose(known.of_points(first, first), COMMON[:3, :3], atol=1e-6)
    np.testing.assert_allclose(known.of_points(first, second), COMMON[:3, :3], atol=1e-6)


def test_image_errors_are_those_of_the_point_alone():
    found = block()
    exact, known = StoredCovariance(found, 0.0), StoredCovariance(found, 0.5)
    first, second = (known.rays(place) for place in places(found))
    own = known.of_points(first, first) - exact.of_points(*[exact.rays(places(found)[0])] * 2)
    assert np.linalg.eigvalsh(own).min() > 0
    np.testing.assert_allclose(known.of_points(first, second), COMMON[:3, :3], atol=1e-6)


def test_what_is_not_stored_is_not_made_up():
    found = block(joint=False)
    known = StoredCovariance(found, 0.5)
    first, second = (known.rays(place) for place in places(found))
    assert known.of_points(first, second) is None
    assert known.of_photos(*found.names[:2]) is None
    assert known.rays(np.array([1e6, 1e6, 0.0])) is None


@pytest.mark.parametrize("number", [0, 1])
def test_a_photograph_has_its_own(number):
    found = block()
    name = found.names[number]
    np.testing.assert_array_equal(StoredCovariance(found, 0.5).of_photos(name, name), COMMON)
