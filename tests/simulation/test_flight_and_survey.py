"""The flight is the published one, the survey keeps to its sigmas, and the boards calibrate the camera."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from small_block import FLIGHT, scene, site, whole

from benchmarks.calibration.board_setups import floor_corners
from orthomill.schemas.raster import Window, tiles_of
from orthomill.schemas.truth import Material
from orthomill.tasks.geometry.view import view_of
from orthomill.tasks.simulation.boards.project_boards import (
    BOARD,
    CORNERS,
    SQUARE,
    BoardPhoto,
    board_places,
    board_view,
    render_boards,
)
from orthomill.tasks.simulation.flight import FlightSettings, camera_of, orientations, true_block, views
from orthomill.tasks.simulation.scene.hash_noise import normal_of, value_noise
from orthomill.tasks.simulation.simulated_tiles import see, sight_window
from orthomill.tasks.simulation.stage import SimulationStage
from orthomill.tasks.simulation.surveying import (
    SurveySettings,
    farthest_first,
    find_place,
    lattice,
    positions,
    search_window,
    survey,
)

SURVEY = SurveySettings(5, 4, 0.02, 0.1, 0.3)
FULL = FlightSettings(2009, 230.0, 153.353, 96.0, 6800.0, 582.0, 0.6, 2, 3)


def test_the_flight_is_the_published_one():
    camera, photos = camera_of(FULL), orientations(FULL)
    assert (camera.width, camera.height) == (2396, 2396)
    assert camera.c * 0.096 == pytest.approx(153.353)
    assert [photo.photo for photo in photos] == [f"volos_{s}_{n}" for s in (1, 2) for n in (1, 2, 3)]
    centres = np.array([photo.centre for photo in photos])
    assert np.linalg.norm(centres[1] - centres[0]) == pytest.approx(582.0, abs=35.0)
    assert centres[3, 0] > centres[5, 0] + 1000.0
    assert centres[5, 1] - centres[0, 1] == pytest.approx(625.6, abs=35.0)
    tilt = np.array([photo.omega_phi_kappa for photo in photos])
    assert np.abs(tilt[:, :2]).max() <= 1.6 and np.abs(tilt[:3, 2]).max() <= 2.0 and np.abs(tilt[3:, 2] - 180.0).max() <= 2.0


def test_full_size_has_the_same_flight_and_camera():
    fine = replace(FULL, pixel_um=15.0)
    assert camera_of(fine).width == 15333 and orientations(fine) == orientations(FULL)
    assert camera_of(fine).x0 * 15.0 == pytest.approx(camera_of(FULL).x0 * 96.0)
    assert camera_of(fine).lens == camera_of(FULL).lens


def test_the_true_block_gives_the_true_views():
    block = true_block(FLIGHT, scene(), "EPSG:2100")
    for view in views(FLIGHT):
        stored = view_of(block.of(view.name), block.camera_of(view.name))
        assert stored.numbers == view.numbers
    assert block.ground_low < whole().surface.height.min() < whole().surface.height.max() < block.ground_high


def places():
    grid, found = site().grid, []
    for node in lattice(FLIGHT, 9):
        window = search_window(grid, node)
        wide = sight_window(site(), window)
        seen = see(whole().surface.height[wide.slices], site(), window, wide)
        surface = whole().surface
        found.append(find_place(node, grid, window, (surface.height[window.slices], surface.material[window.slices], seen)))
    return tuple(found)


def test_points_are_on_open_ground_and_measurements_keep_to_their_sigma():
    points = places()
    control, measured = survey(FLIGHT, SURVEY, points)
    true = np.array([point.xyz for point in points])
    col, row = (np.rint(part).astype(int) for part in site().grid.pixel(true[:, 0], true[:, 1]))
    assert np.isin(whole().surface.material[row, col], (Material.OPEN_GROUND, Material.FIELD)).all()
    assert np.allclose(whole().surface.height[row, col], true[:, 2], atol=1e-6)
    surveyed = np.column_stack([control.x, control.y, control.z])
    assert np.abs(surveyed - true).max() < 4.5 * 0.02 and (surveyed - true).std() > 0.01
    assert (control.role == "control").sum() == 5 and (control.role == "check").sum() == 4
    photos = {view.name: view for view in views(FLIGHT)}
    of_name = dict(zip(control.name, true, strict=True))
    residuals = np.array(
        [
            [c, r] - photos[photo].project(of_name[name][None])[0]
            for name, photo, c, r in zip(measured.name, measured.photo, measured.col, measured.row, strict=True)
        ]
    )
    assert residuals.std() == pytest.approx(0.3, abs=0.1) and np.abs(residuals).max() < 1.4
    assert all((measured.name == name).sum() >= 2 for name in control.name)


def test_a_survey_without_points_is_empty():
    control, measured = survey(FLIGHT, replace(SURVEY, control=0, check=0), ())
    assert len(control) == 0 and len(measured) == 0


def test_gnss_keeps_to_its_sigma():
    rows = positions(FLIGHT, SURVEY)
    true = np.array([view.centre for view in views(FLIGHT)])
    errors = np.column_stack([rows.x, rows.y, rows.z]) - true
    assert 0.04 < errors.std() < 0.17 and np.abs(errors).max() < 0.4
    assert rows.photo.tolist() == [view.name for view in views(FLIGHT)]


def test_control_frames_the_block():
    nodes = np.array(lattice(FULL, 16))
    order = farthest_first(nodes)
    corners = {(x, y) for x in (nodes[:, 0].min(), nodes[:, 0].max()) for y in (nodes[:, 1].min(), nodes[:, 1].max())}
    assert order[0] == 0 and corners <= {tuple(node) for node in nodes[:8].tolist()}


def test_boards_fit_in_two_tilings():
    camera, photo = camera_of(FLIGHT), BoardPhoto(1, 5, 2009, 2.0)
    image = render_boards(camera, photo, Window(0, 0, camera.height, camera.width))
    tiles = np.zeros_like(image)
    for tile in tiles_of(image.shape, 250):
        tiles[tile.window.slices] = render_boards(camera, photo, tile.window)
    assert np.array_equal(image, tiles)


def test_corners_are_where_the_board_has_them():
    camera = camera_of(FLIGHT)
    found = 0
    for number in range(6):
        photo = BoardPhoto(number, 5, 2009, 2.0)
        image = render_boards(camera, photo, Window(0, 0, camera.height, camera.width))
        pixels = board_view(camera, photo).project(floor_corners(board_places(5), BOARD).reshape(-1, 3)).reshape(5, -1, 2)
        for board in pixels:
            if ((board < 12) | (board > camera.width - 13)).any() or np.linalg.norm(board[1] - board[0]) < 12:
                continue
            start = np.ascontiguousarray(board, np.float32)
            corners = cv2.cornerSubPix(image, start, (4, 4), (-1, -1), (3, 30, 0.001)).reshape(-1, 2)
            assert np.sqrt(((corners - board) ** 2).mean()) < 0.12
            assert np.abs((corners - board).mean(axis=0)).max() < 0.04
            found += 1
    assert found >= 5
    assert CORNERS[0] != CORNERS[1] and SQUARE > 0


def test_hashed_noise_is_normal_and_without_neighbours():
    draw = np.array([[normal_of(3, row, col) for col in range(200)] for row in range(-100, 100)])
    assert draw.mean() == pytest.approx(0.0, abs=0.02) and draw.std() == pytest.approx(1.0, abs=0.02)
    assert np.corrcoef(draw[:, 1:].ravel(), draw[:, :-1].ravel())[0, 1] == pytest.approx(0.0, abs=0.02)
    assert np.corrcoef(draw[1:].ravel(), draw[:-1].ravel())[0, 1] == pytest.approx(0.0, abs=0.02)
    assert abs(value_noise(5, 3.0 - 1e-9, 7.4) - value_noise(5, 3.0 + 1e-9, 7.4)) < 1e-6


def test_too_many_photos_are_refused():
    with pytest.raises(ValueError, match="at most 32"):
        SimulationStage(strips=8, photos_per_strip=8)
