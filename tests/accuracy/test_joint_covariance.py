"""Covariances of points against errors of orientations that are known to be common, or apart."""

import numpy as np
import pytest
from shifted_block import COMMON, shifted_block, shown_places

from orthomill.tasks.accuracy.adjustment.joint_covariance import StoredCovariance


def test_points_move_with_what_moves_all_photographs():
    found = shifted_block()
    known = StoredCovariance(found, 0.0)
    first, second = (known.rays(place) for place in shown_places(found))
    np.testing.assert_allclose(known.of_points(first, first), COMMON[:3, :3], atol=1e-6)
    np.testing.assert_allclose(known.of_points(first, second), COMMON[:3, :3], atol=1e-6)


def test_image_errors_are_those_of_the_point_alone():
    found = shifted_block()
    exact, known = StoredCovariance(found, 0.0), StoredCovariance(found, 0.5)
    first, second = (known.rays(place) for place in shown_places(found))
    own = known.of_points(first, first) - exact.of_points(*[exact.rays(shown_places(found)[0])] * 2)
    assert np.linalg.eigvalsh(own).min() > 0
    np.testing.assert_allclose(known.of_points(first, second), COMMON[:3, :3], atol=1e-6)


def test_what_is_not_stored_is_not_made_up():
    found = shifted_block(joint=False)
    known = StoredCovariance(found, 0.5)
    first, second = (known.rays(place) for place in shown_places(found))
    assert known.of_points(first, second) is None
    assert known.of_photos(*found.names[:2]) is None
    assert known.rays(np.array([1e6, 1e6, 0.0])) is None


@pytest.mark.parametrize("number", [0, 1])
def test_a_photograph_has_its_own(number):
    found = shifted_block()
    name = found.names[number]
    np.testing.assert_array_equal(StoredCovariance(found, 0.5).of_photos(name, name), COMMON)
