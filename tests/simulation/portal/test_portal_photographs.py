"""Photographs of the portal: the same on any tiling, and where the true orientation and the true orthoimage say."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.distortion import image_to_pixel
from orthomill.tasks.simulation.portal.portal_block import (
    portal_block,
    portal_camera,
    portal_exposure,
    portal_views,
    to_portal,
    to_system,
)
from orthomill.tasks.simulation.portal.portal_rendering import (
    front_orthoimage,
    lit_scene,
    photograph_portal,
    scene_of_photograph,
    sees,
)
from orthomill.tasks.simulation.portal.portal_survey import scan_text, scanned_portal, survey_portal
from orthomill.tasks.simulation.portal.portal_targets import CONTROL, TARGETS

REDUCTION = 6.0
SEED = 2009


@pytest.fixture(scope="module")
def middle():
    """The third photograph, small, without noise."""
    view = portal_views(REDUCTION)[2]
    return view, photograph_portal(view, 2, SEED, 0.0, Window(0, 0, view.camera.height, view.camera.width))


@pytest.mark.parametrize(("r", "expected"), [(400, -1.9), (800, -13.7), (1200, -39.3), (1296, -47.0), (1620, -72.0)])
def test_distortion_is_that_of_the_published_table(r, expected):
    camera = portal_camera()
    ideal = np.array([[0.6 * r, 0.8 * r]])
    plain = camera.changed(k1=0.0, k2=0.0)
    shift = (image_to_pixel(camera, ideal) - image_to_pixel(plain, ideal))[0] * (1, -1)
    assert shift @ (0.6, 0.8) == pytest.approx(expected, abs=0.1)


def test_tiles_of_a_photograph_fit_bit_for_bit(middle):
    view, whole = middle
    window = Window(37, 90, 81, 64)
    tile = photograph_portal(view, 2, SEED, 0.0, window)
    assert np.array_equal(tile, whole[37:118, 90:154])


def test_the_photograph_shows_what_the_true_orthoimage_shows(middle):
    view, photo = middle
    grid = MapGrid(west=-2.4, north=5.4, cell=0.02, rows=230, cols=240)
    light, depth = front_orthoimage(grid, Window(0, 0, *grid.shape), SEED)
    x, z = grid.centres(Window(0, 0, *grid.shape))
    places = np.stack(np.broadcast_arrays(x[None, :], -depth - 1e-4, z[:, None]), axis=2).reshape(-1, 3)
    # People stand before the portal in this photograph: their places are left out.
    seen = sees(scene_of_photograph(view, 2, SEED), view, places)
    col, row = view.project(to_system(places[seen])).T
    shown = map_coordinates(photo.mean(axis=2), [row, col], order=1)
    true = light.mean(axis=2).ravel()[seen]
    assert seen.mean() > 0.6 and np.corrcoef(shown, true)[0, 1] > 0.93
    moved = map_coordinates(photo.mean(axis=2), [row, col + 3], order=1)
    assert np.corrcoef(moved, true)[0, 1] < np.corrcoef(shown, true)[0, 1] - 0.01


def test_the_front_has_the_depths_of_its_parts():
    grid = MapGrid(west=-2.0, north=4.0, cell=0.05, rows=80, cols=80)
    _, depth = front_orthoimage(grid, Window(0, 0, *grid.shape), SEED)

    def at(x, z):
        return depth[round((4.0 - z) / 0.05 - 0.5), round((x + 2.0) / 0.05 - 0.5)]

    assert at(-1.925, 2.0) == pytest.approx(0.0, abs=1e-6), "the wall"
    assert at(0.025, 1.5) == pytest.approx(-1.1, abs=1e-6), "the door"
    assert at(-1.725, 2.0) == pytest.approx(0.9, abs=0.01), "a column"
    assert at(0.025, 0.1) == pytest.approx(1.9, abs=1e-6), "the lowest step"
    tile = front_orthoimage(grid, Window(20, 30, 40, 40), SEED)[1]
    assert np.array_equal(tile, depth[20:60, 30:70])


def test_people_and_leaves_are_in_their_photographs_only():
    views = portal_views(REDUCTION)
    at_rest, third, last = (len(s.mesh.triangles) for s in (lit_scene(), *(scene_of_photograph(views[k], k, SEED) for k in (2, 6))))
    assert third > at_rest == last
    behind = np.array([[-2.0, 0.0, 1.0]])
    hidden = [not sees(scene_of_photograph(views[k], k, SEED), views[k], behind)[0] for k in range(7)]
    assert hidden[2] and not all(hidden)


def test_exposures_differ():
    gains = {portal_exposure(SEED, k).gain for k in range(7)}
    assert len(gains) == 7 and portal_exposure(SEED, 1) == portal_exposure(SEED, 1)


def test_the_block_holds_the_camera_and_seven_orientations():
    block = portal_block("EPSG:3857")
    assert len(block.photos) == 7 and block.camera_of("portal_1").c == pytest.approx(2573.94)
    assert to_portal(to_system(TARGETS)) == pytest.approx(TARGETS)


def test_targets_are_measured_where_they_are_seen():
    control, measured = survey_portal(SEED, 1.0, (0.001, 0.2))
    assert (control.role == "control").sum() == CONTROL == 18
    true = to_system(TARGETS)
    assert np.abs(np.column_stack([control.x, control.y, control.z]) - true).max() < 0.005
    places = dict(zip(control.name, true, strict=True))
    views = {view.name: view for view in portal_views()}
    for name, photo, col, row in zip(measured.name, measured.photo, measured.col, measured.row, strict=True):
        assert np.abs(views[photo].project(places[name][None])[0] - (col, row)).max() < 1.0
    count = [(measured.name == name).sum() for name in control.name]
    assert np.mean(count) > 4.5 and min(count) >= 2, "nearly all in all photographs"


def test_the_scan_has_its_noise_and_holes():
    mesh = scanned_portal(SEED, 0.2, 0.0014)
    points = to_portal(mesh.vertices)
    on_wall = (np.abs(points[:, 1]) < 0.05) & (points[:, 2] > 0.6) & (np.abs(points[:, 0]) > 2.4) & (points[:, 2] < 5)
    assert 0.0007 < points[on_wall, 1].std() < 0.0021
    assert len(scanned_portal(SEED, 0.2, 0.0).triangles) == len(mesh.triangles), "noise makes no holes"
    assert points[:, 2].max() < 6.8 and np.abs(points[:, 0]).max() < 3.9
    text = scan_text(mesh).text.splitlines()
    assert (
        text[0] == "ply"
        and f"element vertex {len(mesh.vertices)}" in text
        and len(text) == 10 + len(mesh.vertices) + len(mesh.triangles)
    )
