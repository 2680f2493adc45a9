"""Seven parameters: exact, robust, and on a line with the help of the vertical."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.start.similarity import VerticalityConstraint, consensus, fit_similarity, turn_precision

NO = VerticalityConstraint(np.array([0.0, 0.0, 1.0]), 0.0)


@settings(max_examples=40, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.floats(0.01, 100), st.tuples(*[st.floats(-1e4, 1e4)] * 3))
def test_exact_points_are_met(turn, scale, shift):
    model = np.random.default_rng(1).standard_normal((6, 3))
    ground = scale * model @ rotation_matrix(*turn).T + shift
    found = fit_similarity(model, ground, np.full(6, 0.1), NO)
    assert np.allclose(found.apply(model), ground, atol=1e-6 * (1 + scale))
    assert np.isclose(found.scale, scale, rtol=1e-6)


def test_one_wrong_point_does_no_harm():
    model = np.random.default_rng(2).standard_normal((9, 3)) * 50
    ground = 2 * model @ rotation_matrix(0.1, 0.2, 2.0).T + 100
    ground[4] += 500
    found = fit_similarity(model, ground, np.full(9, 1.0), NO)
    assert np.abs(np.delete(found.apply(model) - ground, 4, axis=0)).max() < 5


def test_points_on_a_line_are_levelled_by_the_vertical():
    model = np.outer(np.arange(5.0), [1.0, 0.2, 0.1])
    rotation = rotation_matrix(0.3, -0.2, 1.0)
    up = rotation.T @ [0, 0, 1]
    ground = 7 * model @ rotation.T + 10
    found = fit_similarity(model, ground, np.full(5, 1.0), VerticalityConstraint(up, 1e4))
    assert np.allclose(found.rotation, rotation, atol=1e-6)


def test_turn_precision_tells_lines_from_areas():
    line = np.outer(np.arange(8.0) * 20, [1, 0, 0]) + np.random.default_rng(3).standard_normal((8, 3))
    area = np.array([(x, y, 0.0) for x in (0, 100, 200) for y in (0, 100)])
    assert np.degrees(turn_precision(line, np.full(8, 3.0))) > 1
    assert np.degrees(turn_precision(area, np.full(6, 0.1))) < 0.2


def test_one_point_is_refused():
    with pytest.raises(GeometryError, match="two or more"):
        fit_similarity(np.zeros((1, 3)), np.zeros((1, 3)), np.ones(1), NO)


@pytest.mark.parametrize(("sigma", "off", "aside"), [(0.03, 0.02, 1), (0.03, 3.0, 1), (2.0, 2.0, 1)])
def test_a_wrong_point_is_far_from_the_consensus_however_good_the_others_are(sigma, off, aside):
    rng = np.random.default_rng(8)
    model = rng.uniform(-1.0, 1.0, (9, 3)) * [20.0, 20.0, 2.0]
    ground = model + off * rng.standard_normal((9, 3))
    ground[3] += [60.0, 0.0, 0.0]
    miss = consensus(model, ground, np.full(9, sigma), NO, np.ones(9, bool))
    # Control of metres that is stated to centimetres agrees within metres: three points that fit by chance are no consensus.
    assert list(np.flatnonzero(miss >= 5.0)) == [3] * aside
    assert (np.delete(miss, 3) < 1.0).mean() >= 0.5
