"""One contract, two surfaces: a height model and the same surface as a mesh say the same of every place."""

from dataclasses import replace

import numpy as np
import pytest
from box_scene import BOX, DSM, heights, sees, view

from orthomill.schemas.raster import Window
from orthomill.tasks.visibility.height_model import HeightModel, Targets
from orthomill.tasks.visibility.height_triangles import height_triangles
from orthomill.tasks.visibility.lines_of_sight import HeightPlaces
from orthomill.tasks.visibility.mesh_sight import MeshPlaces, SightTolerance
from orthomill.tasks.visibility.output_frame import ideal_window
from orthomill.tasks.visibility.scanline import central_projection
from orthomill.tasks.visibility.sight import PlaceSight, SurfacePlaces
from orthomill.tasks.visibility.triangle_blocks import SIDE, TrianglesAtHand, as_blocks
from tests.support.solid.whole_mesh import nearest_triangles

WHOLE = Window(0, 0, DSM.rows, DSM.cols)
SLOPES = np.zeros((DSM.rows, DSM.cols), np.float32)
ORIGIN = np.zeros(3)


def hole() -> np.ndarray:
    """The box, and a hole in the ground."""
    z = heights()
    z[10:14, 10:14] = np.nan
    return z


def points(z: np.ndarray) -> np.ndarray:
    """(N, 3) the centres of the cells."""
    x, y = np.meshgrid(*DSM.centres(WHOLE))
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def as_heights(z: np.ndarray, photo) -> SurfacePlaces:
    index = np.arange(DSM.rows)
    model = HeightModel(z, DSM, WHOLE)
    return HeightPlaces(model, model, Targets(index, index, z, SLOPES), np.zeros_like(z), 0.3)


def as_mesh(z: np.ndarray, photo) -> SurfacePlaces:
    mesh = height_triangles(z, DSM)
    corners = mesh.vertices[mesh.triangles].astype(np.float32)
    blocks = tuple(as_blocks(corners).reshape(-1, SIDE, SIDE, 9))
    own = np.full(z.shape, -1, np.int32)
    # Any of the triangles that meet in the centre of a cell.

    for k in range(3):
        col, row = DSM.pixel(*mesh.vertices[mesh.triangles[:, k], :2].T)
        level = np.ptp(mesh.vertices[mesh.triangles][..., 2], axis=1) == 0
        at = np.rint(row).astype(int), np.rint(col).astype(int)
        # A wall shows its places only from before it; level triangles tell what is seen from above.
        own[at] = np.where(level | (own[at] < 0), np.arange(len(mesh.triangles)), own[at])
    raster = nearest_triangles(central_projection(photo, ORIGIN), mesh.vertices, mesh.triangles, ideal_window(photo.camera))
    at_hand = TrianglesAtHand.of(tuple(range(len(blocks))), blocks)
    return MeshPlaces(points(z), own.ravel(), {photo.name: raster}, at_hand, SightTolerance())


@pytest.fixture(scope="module", params=[as_heights, as_mesh], ids=["height model", "mesh"])
def surface(request):
    return request.param


@pytest.mark.parametrize("name", ["a", "c", "d"])
def test_a_surface_of_either_kind_sees_what_rays_see(surface, name):
    z, photo = hole(), view(name)
    found = surface(z, photo).sights(photo).reshape(z.shape)
    known, truth = np.isfinite(z), sees(photo, np.nan_to_num(points(z))).reshape(z.shape)
    np.testing.assert_array_equal(found == PlaceSight.NOWHERE, ~known)
    inside = photo.contains(photo.project(np.nan_to_num(points(z))), 2.0).reshape(z.shape)
    assert (found[known & inside] != PlaceSight.OUTSIDE).all()
    # Between the cells of a wall either of its sides may be the surface.
    core = known & inside
    west, east, south, north, _ = BOX
    row, col = np.indices(z.shape)
    x, y = DSM.west + col + 0.5, DSM.north - row - 0.5
    core &= ~((np.minimum(abs(x - west), abs(x - east)) < 1.5) | (np.minimum(abs(y - south), abs(y - north)) < 1.5))
    assert np.mean((found >= PlaceSight.AT_BREAK)[core] == truth[core]) > 0.995
    assert (found == PlaceSight.HIDDEN).sum() > 30 and (found == PlaceSight.AT_BREAK).any()


def test_both_surfaces_agree_place_by_place():
    z, photo = hole(), view("c")
    one, two = (kind(z, photo).sights(photo).reshape(z.shape) >= PlaceSight.AT_BREAK for kind in (as_heights, as_mesh))
    assert np.mean(one == two) > 0.99


def test_beside_the_frame_nothing_is_seen(surface):
    z, photo = hole(), view("a")
    aside = replace(photo, centre=photo.centre + np.array([900.0, 0.0, 0.0]))
    found = surface(z, aside).sights(aside).reshape(z.shape)
    assert (found[np.isfinite(z)] == PlaceSight.OUTSIDE).all() and (found[~np.isfinite(z)] == PlaceSight.NOWHERE).all()
