"""A mesh from a file is made fit for use, and what was wrong with it is counted."""

import numpy as np
import pytest

from orthomill.schemas.errors import GeometryError, WorkflowError
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.projection.mesh.mesh_mending import MendedMesh, mend_heights, mend_mesh
from orthomill.tasks.visibility.triangle_blocks import PER_BLOCK, TrianglesAtHand, as_blocks, block_bounds, spatial_order

NO_SHIFT = (0.0, 0.0, 0.0)


def square(shift=(0.0, 0.0, 0.0)) -> TriangleMesh:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) + shift
    return TriangleMesh(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def corners_of(mended: MendedMesh) -> np.ndarray:
    points = np.column_stack([mended.vertices.x, mended.vertices.y, mended.vertices.z]) + mended.census.origin
    return points[np.column_stack([mended.triangles.a, mended.triangles.b, mended.triangles.c])]


def test_what_is_wrong_is_left_out_and_counted():
    vertices = np.vstack([square().vertices, [[np.nan, 0, 0], [2, 0, 0], [0, 1, 0]]])
    # Twice with other corners first and the other way round, once by a second vertex at the same place; on a line; not finite.
    triangles = [[0, 1, 2], [0, 2, 3], [1, 2, 0], [2, 1, 0], [0, 2, 6], [0, 1, 5], [0, 1, 4]]
    census = mend_mesh(TriangleMesh(vertices, np.array(triangles, np.int32)), "m", NO_SHIFT).census
    assert (census.triangles, census.read) == (2, 7)
    assert (census.duplicate, census.degenerate, census.not_finite) == (3, 1, 1)
    assert (census.bodies, census.open_edges) == (1, 4)


def test_bodies_and_rims_are_those_of_places_not_of_vertices():
    # As in STL: every triangle has vertices of its own.
    soup = square().corners.reshape(-1, 3)
    far = soup + np.array([10.0, 0, 0])
    mesh = TriangleMesh(np.vstack([soup, far]), np.arange(12, dtype=np.int32).reshape(-1, 3))
    census = mend_mesh(mesh, "m", NO_SHIFT).census
    assert (census.bodies, census.open_edges) == (2, 8)


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("ft", 0.3048)])
def test_unit_and_shift_bring_it_into_the_project(unit, metres):
    mended = mend_mesh(square(), unit, (1000.0, 2000.0, 30.0))
    found = np.sort(corners_of(mended).reshape(-1, 3), axis=0)
    expected = np.sort(square().corners.reshape(-1, 3) * metres + [1000.0, 2000.0, 30.0], axis=0)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_nothing_usable_is_a_sentence():
    flat = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]], np.int32))
    with pytest.raises(GeometryError, match=r"None of the 1 triangles of the mesh can be used: 0 .* 1 have no area"):
        mend_mesh(flat, "m", NO_SHIFT)
    with pytest.raises(GeometryError, match="no vertex with finite coordinates"):
        mend_mesh(TriangleMesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]], np.int32)), "m", NO_SHIFT)
    with pytest.raises(GeometryError, match="2 points and no triangles"):
        mend_mesh(TriangleMesh(np.zeros((2, 3)), np.zeros((0, 3), np.int32)), "m", NO_SHIFT)
    with pytest.raises(GeometryError, match="cannot be triangulated"):
        mend_mesh(TriangleMesh(np.arange(15.0).reshape(5, 3), np.zeros((0, 3), np.int32)), "m", NO_SHIFT)


def test_coordinates_of_seven_digits_are_caught_and_fine_ones_are_not():
    fine = TriangleMesh(square().vertices * 0.01 + [476000.3, 4204000.7, 100.0], square().triangles)
    assert mend_mesh(fine, "m", NO_SHIFT).census.triangles == 2
    rounded = TriangleMesh(fine.vertices.astype(np.float32).astype(float) + square().vertices, fine.triangles)
    with pytest.raises(GeometryError, match=r"rounded to 0.5 units .* an\s+origin near the object"):
        mend_mesh(rounded, "m", NO_SHIFT)


def test_a_point_cloud_becomes_a_surface_without_bridging_gaps():
    x, y = (values.ravel() for values in np.meshgrid(np.linspace(0, 1, 30), np.linspace(0, 1, 30)))
    # A wall with a gap of a third of its width, seen along y.
    kept = (x < 0.35) | (x > 0.65)
    wall = np.column_stack([x, 0.01 * np.sin(9 * x), y])[kept]
    census = mend_mesh(TriangleMesh(wall, np.zeros((0, 3), np.int32)), "m", NO_SHIFT).census
    assert census.triangulated and census.read == 0 and census.bodies == 2


def test_blocks_hold_every_triangle_once_and_near_each_other():
    rng = np.random.default_rng(5)
    corners = rng.uniform(-5, 5, (3 * PER_BLOCK - 7, 1, 3)) + rng.normal(0, 0.01, (1, 3, 3))
    corners = corners[spatial_order(corners.mean(axis=1))]
    raster = as_blocks(corners)
    bounds = block_bounds(raster)
    assert raster.shape == (3 * 128, 128, 9) and np.isnan(raster[-1, -7:]).all()
    # A third of the cube each, and not the whole cube.
    assert np.prod(np.diff(bounds, axis=1)[:, 0], axis=1).sum() < 2.2 * 1000
    at_hand = TrianglesAtHand.of((0, 2), (raster[:128], raster[256:]))
    numbers = np.array([5, 2 * PER_BLOCK + 3])
    np.testing.assert_allclose(at_hand.corners_of(numbers), corners[numbers], atol=1e-6)
    assert at_hand.places.tolist() == [0, -1, PER_BLOCK, -1]


def test_a_file_with_y_upwards_is_stood_up():
    mesh = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, -3]]), np.array([[0, 1, 2]], np.int32))
    mended = mend_mesh(mesh, "m", NO_SHIFT, y_up=True)
    found = corners_of(mended)[0]
    np.testing.assert_allclose(found[np.lexsort(found.T[::-1])], [[0, 0, 0], [0, 3, 2], [1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("system", ["EPSG:4326", "EPSG:4979", "EPSG:4978", "EPSG:32634"])
def test_a_mesh_of_another_system_comes_into_that_of_the_project(system):
    from pyproj import CRS, Transformer

    ground = square().vertices * 30 + [476000.0, 4204000.0, 55.0]
    project, solid = CRS("EPSG:2100"), system in ("EPSG:4979", "EPSG:4978")
    there = Transformer.from_crs(project.to_3d() if solid else project, CRS(system), always_xy=True)
    x, y, *z = there.transform(*ground[:, : 3 if solid else 2].T)
    stored = np.column_stack([x, y, z[0] if solid else ground[:, 2]])
    mended = mend_mesh(TriangleMesh(stored, square().triangles), "m", NO_SHIFT, systems=(system, "EPSG:2100"))
    assert mended.census.system == system
    found = np.sort(corners_of(mended).reshape(-1, 3), axis=0)
    np.testing.assert_allclose(found, np.sort(ground[square().triangles].reshape(-1, 3), axis=0), atol=2e-3)


def test_a_system_that_is_unknown_or_elsewhere_is_a_sentence():
    with pytest.raises(WorkflowError, match="'EPSG:99' of the surface is unknown to PROJ"):
        mend_mesh(square(), "m", NO_SHIFT, systems=("EPSG:99", "EPSG:2100"))
    with pytest.raises(WorkflowError, match="no place in the project's system EPSG:2100: is it in EPSG:4326"):
        mend_mesh(square((476000.0, 4204000.0, 0.0)), "m", NO_SHIFT, systems=("EPSG:4326", "EPSG:2100"))


def test_triangles_that_face_opposite_ways_are_counted():
    upside = TriangleMesh(square().vertices, np.array([[0, 1, 2], [0, 3, 2]], np.int32))
    assert mend_mesh(upside, "m", NO_SHIFT).census.turned_edges == 1
    assert mend_mesh(square(), "m", NO_SHIFT).census.turned_edges == 0


GRID = MapGrid(west=476000.0, north=4204000.0, cell=0.5, rows=6, cols=8)


@pytest.mark.parametrize("every", [1, 2, 4])
def test_cells_of_half_metres_are_no_rounding(every):
    """Their middles are numbers that 32 bits hold, as the heights are."""
    grid = MapGrid(west=407600.25, north=4357292.25, cell=0.5, rows=40, cols=40)
    heights = np.random.default_rng(3).normal(30, 0.1, grid.shape).astype(np.float32)
    assert mend_heights(heights, grid, every).census.triangles == 2 * (40 // every - 1) ** 2


def test_a_height_model_becomes_triangles_that_face_upwards_around_its_holes():
    heights = np.add.outer(np.arange(6.0), 0.5 * np.arange(8.0))
    heights[2, 3] = np.nan
    mended = mend_heights(heights, GRID, 1)
    corners = corners_of(mended)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # 35 squares; each of the four about the hole keeps the triangle that does not touch it.
    assert len(corners) == 2 * 31 + 4 and (normal[:, 2] > 0).all()
    x, y, z = corners.reshape(-1, 3).T
    np.testing.assert_allclose(z, (4203999.75 - y) / 0.5 + 0.5 * (x - 476000.25) / 0.5, atol=1e-6)


def test_every_second_cell_of_a_height_model_stays_in_its_place():
    heights = np.tile(0.25 * (np.arange(8.0) + 0.5), (6, 1))
    x, _, z = corners_of(mend_heights(heights, GRID, 2)).reshape(-1, 3).T
    assert len(x) == 3 * 2 * 2 * 3
    np.testing.assert_allclose(z, 0.25 * (x - 476000.0) / 0.5, atol=1e-6)


def test_a_height_model_of_holes_is_a_sentence():
    with pytest.raises(GeometryError, match="no three heights beside each other"):
        mend_heights(np.full((6, 8), np.nan), GRID, 1)


def test_no_block_of_triangles_lies_across_the_mesh():
    """A sheet that is long, thin and bent: a curve through space leaves it and comes back elsewhere."""
    along, across = np.meshgrid(np.linspace(0, 40, 1600), np.linspace(0, 5, 200))
    places = np.stack([along, across, 4 * np.sin(along / 6)], axis=-1).reshape(-1, 3)
    order = spatial_order(places)
    assert np.array_equal(np.sort(order), np.arange(len(places)))
    blocks = [places[order[first : first + PER_BLOCK]] for first in range(0, len(places), PER_BLOCK)]
    sides = [np.ptp(block, axis=0).max() for block in blocks]
    assert len(blocks) == 20 and max(sides) < 2 * np.median(sides)
