"""A part of a height model as triangles: each where its cells are, with the colours above them."""

import numpy as np

from orthomill.tasks.projection.model.glb import from_jpeg
from orthomill.tasks.projection.model.height_patch import height_patch

CORNER = np.array([10.0, 20.0, 0.0])


def plane(rows=5, cols=7):
    row, col = np.mgrid[:rows, :cols].astype(float)
    return 30 + 0.5 * col - 0.25 * row


def test_vertices_are_the_centres_of_cells_and_triangles_face_up():
    part = height_patch(plane(), 2.0, CORNER, np.full((10, 14, 3), 90, np.uint8), 0.0)
    assert len(part.vertices) == 35 and len(part.triangles) == 2 * 4 * 6
    x, y, z = part.vertices.T
    assert np.allclose(z, 30 + 0.5 * (x - 10) / 2 + 0.25 * (y - 20) / 2) and x.max() == 22 and y.min() == 12
    a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all() and np.isclose(0.5 * normals[:, 2].sum(), 12 * 8)


def test_the_picture_is_seen_where_its_cell_is():
    """A picture red in the east and blue in the north; the place of a vertex in it is the centre of its cell."""
    picture = np.zeros((50, 70, 3), np.uint8)
    picture[:, 30:, 0], picture[:20, :, 2] = 200, 200
    part = height_patch(plane(), 2.0, CORNER, picture, 0.0)
    pixels = from_jpeg(part.texture)
    col, row = np.floor(part.places * [70, 50]).astype(int).T
    assert np.allclose(part.places[:, 0] * 70, 10 * ((part.vertices[:, 0] - 10) / 2 + 0.5))
    colours = pixels[row, col]
    east, north = part.vertices[:, 0] > 15.5, part.vertices[:, 1] > 16.5
    assert ((colours[:, 0] > 100) == east).all() and ((colours[:, 2] > 100) == north).all()


def test_where_there_is_no_height_there_is_no_triangle():
    heights = plane()
    heights[2, 3] = np.nan
    part = height_patch(heights, 2.0, CORNER, np.zeros((5, 7, 3), np.uint8), 0.0)
    assert len(part.triangles) == 48 - 6 and np.isfinite(part.vertices).all() and len(part.vertices) == 34
    assert height_patch(np.full((3, 3), np.nan), 1.0, CORNER, np.zeros((3, 3, 3), np.uint8), 1.0) is None


def test_borders_hang_down_so_that_neighbours_of_other_levels_leave_no_crack():
    part = height_patch(plane(), 2.0, CORNER, np.zeros((5, 7, 3), np.uint8), 1.5)
    rim = 2 * (4 + 6)
    assert len(part.triangles) == 48 + 2 * rim
    hanging = part.vertices[35:]
    assert len(hanging) == 2 * rim and all(np.abs(part.vertices[:35] - v - [0, 0, 1.5]).sum(axis=1).min() < 1e-9 for v in hanging)
