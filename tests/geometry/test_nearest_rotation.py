"""The rotation nearest to a matrix: a rotation itself, and the turn between two sets of directions."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.geometry.rotation import nearest_rotation, rotation_matrix

ANGLE = st.floats(-3.0, 3.0)


@settings(deadline=None)
@given(ANGLE, ANGLE, ANGLE)
def test_a_rotation_is_nearest_to_itself(omega, phi, kappa):
    R = rotation_matrix(omega, phi, kappa)
    assert np.allclose(nearest_rotation(2.5 * R), R, atol=1e-12)


@settings(deadline=None)
@given(ANGLE, ANGLE, ANGLE, st.booleans())
def test_it_takes_points_to_their_turned_places_and_never_mirrors(omega, phi, kappa, flat):
    R = rotation_matrix(omega, phi, kappa)
    x = np.random.default_rng(4).normal(size=(6, 3)) * [1.0, 1.0, 0.0 if flat else 1.0]
    found = nearest_rotation((x @ R.T).T @ x)
    assert np.allclose(x @ found.T, x @ R.T, atol=1e-9)
    assert np.linalg.det(found) > 0.999
