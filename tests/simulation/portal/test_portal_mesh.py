"""The portal as a mesh: whole, with its fronts towards the street, and with the parts that it is known for."""

import numpy as np
import pytest

from orthomill.tasks.simulation.portal.portal_block import portal_views, to_portal, turn
from orthomill.tasks.simulation.portal.portal_casting import NO_TRIANGLE, cells_of, central_boxes, facets_of, nearest
from orthomill.tasks.simulation.portal.portal_mesh import PortalMaterial, leaves, person, portal_mesh, with_objects

MESH = portal_mesh(0.15)


def test_every_triangle_has_an_area_and_vertices_that_exist():
    facets = facets_of(MESH.vertices, MESH.triangles)
    assert np.isfinite(facets.normals).all() and MESH.triangles.max() < len(MESH.vertices)
    assert len(MESH.material) == len(MESH.triangles) and len(MESH.place) == len(MESH.vertices)


def first_hits(view, mesh, step=0.05):
    """The triangles that a grid of rays of a photograph meets, and whether it sees their fronts."""
    facets, centre, axes = facets_of(mesh.vertices, mesh.triangles), to_portal(view.centre), view.rotation @ turn()
    low, high = central_boxes((mesh.vertices - centre) @ axes.T, mesh.triangles)
    cells = cells_of(low, high, (-0.5, -0.5, 0.5, 0.5), 0.02)
    hits = []
    for a in np.arange(-0.48, 0.48, step):
        for b in np.arange(-0.36, 0.36, step):
            ray = a * axes[0] + b * axes[1] - axes[2]
            hit, *_ = nearest(cells, facets.corner, facets.along, facets.above, a, -b, centre, ray)
            if hit != NO_TRIANGLE:
                hits.append((hit, facets.normals[hit] @ ray < 0))
    return np.array(hits)


@pytest.mark.parametrize("number", range(7))
def test_photographs_see_fronts_only(number):
    hits = first_hits(portal_views()[number], MESH)
    assert len(hits) > 200 and hits[:, 1].all()


def test_photographs_see_columns_steps_the_arch_and_the_niche():
    seen = {int(MESH.material[hit]) for number in (0, 2, 4) for hit, _ in first_hits(portal_views()[number], MESH, 0.02)}
    assert seen >= {
        PortalMaterial.MASONRY,
        PortalMaterial.MARBLE,
        PortalMaterial.STEPS,
        PortalMaterial.FRESCO,
        PortalMaterial.WOOD,
        PortalMaterial.VOUSSOIRS,
    }


def test_people_stand_on_the_steps_and_leaves_hang_where_they_are_put():
    on_ground, on_step = person(0.0, -3.0).vertices[:, 2], person(0.0, -1.2).vertices[:, 2]
    assert on_ground.min() == pytest.approx(0.0) and on_step.min() == pytest.approx(0.45)
    assert 1.6 < np.ptp(on_ground) < 1.9
    twig = leaves(np.array([1.0, -4.0, 3.0]), 0.2, 60, 5)
    assert np.abs(twig.vertices.mean(axis=0) - (1.0, -4.0, 3.0)).max() < 0.1
    both = with_objects(MESH, [twig])
    assert (both.triangles[-1] >= len(MESH.vertices)).all() and both.material[-1] == PortalMaterial.LEAF


def test_a_finer_mesh_is_the_same_shape():
    fine = portal_mesh(0.1)
    assert len(fine.triangles) > 1.5 * len(MESH.triangles)
    assert np.allclose(fine.vertices.max(axis=0), MESH.vertices.max(axis=0), atol=0.01)
