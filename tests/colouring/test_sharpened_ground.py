"""The edge of a roof that the surface model blurs, found again in photographs with analytic truth."""

from dataclasses import replace

import numpy as np
import pytest
from box_scene import BOX, CENTRES, DSM, ORTHO, Vehicle, ground_colour, heights, hits_box, render, view

from orthomill.schemas.raster import Window
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry
from orthomill.tasks.colouring.balance.radiometric_balance import balance_block
from orthomill.tasks.colouring.balance.shared_ground import Samples
from orthomill.tasks.colouring.edges.sharpened_ground import SharpenedGround, sharpened
from orthomill.tasks.colouring.sampling.balanced_photograph import BalancedPhotograph
from orthomill.tasks.colouring.sampling.ground_sampling import ground_of
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt
from orthomill.tasks.visibility.height_model import HeightModel

WHOLE = Window(0, 0, 240, 240)
CELLS = Window(0, 0, 120, 120)


@pytest.fixture(scope="module")
def photos() -> list[BalancedPhotograph]:
    none = Samples(*(np.zeros(0, kind) for kind in (np.int64, np.int32, *4 * (np.float32,))))
    balance: Radiometry = balance_block(list(CENTRES), none, 255.0, False)
    whole = Window(0, 0, 420, 420)
    return [BalancedPhotograph(view(n), PhotoPixelsAt(render(view(n)).astype(np.uint8), whole, 0), balance) for n in CENTRES]


def rounded() -> tuple[np.ndarray, np.ndarray]:
    """The box with its corners cut off and its east side a cell too far, and bool: cells whose height is measured."""
    model, measured = heights(), np.ones((120, 120), bool)
    measured[50:70, 48:72] = False
    measured[54:66, 52:68] = True
    model[52:68, 70] = BOX[4]
    for row, col in ((52, 50), (52, 69), (67, 50), (67, 69), (53, 50), (66, 50), (53, 69), (66, 69)):
        model[row, col] = 0.0
    return model, measured


def made(photos, window: Window = WHOLE) -> SharpenedGround:
    model, measured = rounded()
    ground = ground_of(model, CELLS, DSM, ORTHO, window)
    certain = HeightModel(np.where(measured, model, np.float32(np.nan)), DSM, CELLS)
    return sharpened(ground, model, certain, photos)


def true_heights() -> np.ndarray:
    return heights(ORTHO)


def test_the_roof_gets_its_corners_back(photos):
    found, truth = made(photos), true_heights()
    model, _ = rounded()
    before = ground_of(model, CELLS, DSM, ORTHO, WHOLE).z
    wrong = [np.count_nonzero(np.abs(z - truth)[found.doubtful] > 1.0) for z in (before, found.ground.z)]
    assert found.doubtful.sum() > 500 and wrong[0] > 60 and wrong[1] <= 0.3 * wrong[0]


def test_only_pixels_near_the_wall_are_moved(photos):
    found = made(photos)
    model, _ = rounded()
    before = ground_of(model, CELLS, DSM, ORTHO, WHOLE).z
    np.testing.assert_array_equal(found.ground.z[~found.doubtful], before[~found.doubtful])
    assert not found.doubtful[:80].any() and not found.doubtful[:, :80].any()


def test_photographs_that_the_box_hides_the_ground_from_are_not_alike(photos):
    """Photo a stands in the west, c in the east: each sees the ground on its own side of the box only."""
    found, names = made(photos), list(CENTRES)
    west, east = np.s_[110:130, 98:99], np.s_[110:130, 141:142]
    a, c = found.alike[names.index("a")], found.alike[names.index("c")]
    assert a[west].mean() > 0.9 and c[east].mean() > 0.9 and a[east].mean() < 0.2 and c[west].mean() < 0.2


def test_a_part_of_the_ground_is_sharpened_like_the_whole(photos):
    part = Window(96, 88, 30, 40)
    whole, own = made(photos), made(photos, part)
    np.testing.assert_array_equal(own.ground.z, whole.ground.z[part.slices])
    np.testing.assert_array_equal(own.alike, whole.alike[(slice(None), *part.slices)])


def test_without_photographs_the_ground_stays_as_it_is():
    found = made([])
    assert not found.doubtful.any() and found.alike.shape == (0, 240, 240)


def test_grey_photographs_find_the_roof_too(photos):
    grey = [replace(photo, part=replace(photo.part, pixels=photo.part.pixels[..., :1])) for photo in photos]
    found = made(grey)
    assert np.mean(np.abs(found.ground.z - true_heights())[found.doubtful] > 1.0) < 0.03


def with_grass_on_its_roof(photo: BalancedPhotograph) -> BalancedPhotograph:
    """The photograph of a box whose roof is as green as the ground."""
    camera = photo.view.camera
    col, row = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = photo.view.rays(np.column_stack([col.ravel(), row.ravel()]))
    distance, roof = hits_box(np.broadcast_to(photo.view.centre, rays.shape), rays)
    place = photo.view.centre + rays * np.where(roof, distance, 0.0)[:, None]
    pixels = photo.part.pixels.copy()
    pixels[roof.reshape(pixels.shape[:2])] = ground_colour(place[roof, 0] + 30.0, place[roof, 1]).astype(np.uint8)
    return replace(photo, part=replace(photo.part, pixels=pixels))


def test_a_roof_that_looks_like_the_ground_is_found_by_the_agreement_of_photographs(photos):
    """By likeness alone 211 of its 1680 pixels are on the wrong surface."""
    found = made([with_grass_on_its_roof(photo) for photo in photos])
    assert np.count_nonzero(np.abs(found.ground.z - true_heights())[found.doubtful] > 1.0) < 60


def beside_a_shadow(photos, cells: int) -> SharpenedGround:
    """Shadow along the east wall, and the roof of the model `cells` too wide over it."""
    shadow = Vehicle((BOX[1], BOX[1] + 4.0, BOX[2] - 2.0, BOX[3] + 2.0), (35.0, 40.0, 30.0))
    shaded = [replace(photo, part=replace(photo.part, pixels=render(photo.view, shadow).astype(np.uint8))) for photo in photos]
    model = heights()
    model[52:68, 70 : 70 + cells] = BOX[4]
    return sharpened(ground_of(model, CELLS, DSM, ORTHO, WHOLE), model, HeightModel(model, DSM, CELLS), shaded)


def test_shadow_beside_a_wall_is_coloured_by_photographs_that_show_it(photos):
    """Unlike the ground around it was left to the model, for which all photographs see it that in truth show the roof."""
    found = beside_a_shadow(photos, 3)
    strip = np.s_[110:130, 140:146]
    assert np.count_nonzero(found.doubtful[strip]) > 30 and not (found.ground.z[strip][found.doubtful[strip]] > 1.0).any()
    assert found.alike.any(axis=0)[strip][found.doubtful[strip]].all()


def test_what_lies_beside_a_roof_that_the_model_has_too_wide_is_no_example_of_it(photos):
    """Were it one, 25 pixels would be on the wrong surface."""
    found = beside_a_shadow(photos, 5)
    assert np.count_nonzero(np.abs(found.ground.z - true_heights())[found.doubtful] > 1.0) < 10
