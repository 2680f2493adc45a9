"""A row of points in a photograph: what `framed_point` says of each, for every lens."""

import numpy as np
import pytest

from orthomill.schemas.camera import LENSES, Camera
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import FIELD_MARGIN, View, empty_row, frame_row, framed_point

VALUES = {
    "brown": {"k1": -0.1, "k2": 0.02, "p1": 1e-3, "p2": -2e-3, "affinity": 1e-3, "skew": -2e-3},
    "rational": {"k1": 0.9, "k2": 0.3, "k4": 1.3, "k5": 0.6},
    "fisheye": {"k1": 0.03, "k2": -0.01},
    "division": {"k1": -0.3},
}


@pytest.mark.parametrize("kind", tuple(VALUES))
@pytest.mark.parametrize("roll", [5.0, 40.0, 75.0])
def test_a_row_is_framed_point_by_point(kind, roll):
    camera = Camera(name="c", width=400, height=300, c=350.0, x0=2.0, y0=-3.0, lens=LENSES[kind]()).changed(**VALUES[kind])
    view = View("a", camera, rotation_matrix(*np.radians([3.0, roll, 20.0])), np.array([10.0, -5.0, 120.0]))
    x, y, z = np.linspace(-400.0, 400.0, 801), 7.0, np.random.default_rng(1).uniform(0.0, 150.0, 801).astype(np.float32)
    z[::50] = np.nan
    row, widest = empty_row(x.size), FIELD_MARGIN * view.field
    frame_row(view.numbers, x, y, z, widest, row)
    expected = np.array([framed_point(view.numbers, x[j], y, z[j], widest) for j in range(x.size)])
    inside = expected[:, 3] >= 0
    assert inside.any() and np.array_equal(row.border >= 0, inside) and (row.border[~inside] == -1).all()
    found = np.column_stack([row.col, row.row, 1.0 / row.inverse, row.border])[inside]
    np.testing.assert_allclose(found, expected[inside], rtol=0, atol=1e-8)
