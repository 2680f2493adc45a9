"""Measures of an orthoimage on images with planted errors."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.ndimage import shift as shifted

from orthomill.schemas.raster import Window
from orthomill.schemas.surface import HeightSource
from orthomill.schemas.truth import Material
from orthomill.tasks.evaluation.classes import PlaceClass
from orthomill.tasks.evaluation.orthoimage_accuracy import (
    GreyFit,
    OrthoScene,
    count_ortho,
    doubled,
    fit_grey,
    fitted,
    grey_sums,
    merged_counts,
    shifts,
    structural_similarity,
)

SHAPE = (200, 220)
WHOLE = Window(0, 0, *SHAPE)


def texture(seed: int = 1) -> np.ndarray:
    noise = gaussian_filter(np.random.default_rng(seed).normal(0, 1, (*SHAPE, 1)), (1.5, 1.5, 0))
    return (120 + 30 * noise / noise.std() * np.array([1.0, 0.9, 0.7])).astype(np.float32)


def scene(colour, truth, material=None, seen=3, measured=None, covered=None) -> OrthoScene:
    material = np.full(SHAPE, Material.OPEN_GROUND, np.uint8) if material is None else material
    everywhere, photographs = np.ones(SHAPE, bool), np.full(SHAPE, seen, np.uint8)
    source = np.where(everywhere if measured is None else measured, HeightSource.MEASURED, HeightSource.DRAPED)
    colour, truth = (values.astype(np.float32) for values in (colour, truth))
    return OrthoScene(WHOLE, colour, truth, everywhere if covered is None else covered, material, photographs, source)


def test_holes_on_the_surface_and_beyond_it_are_counted_apart():
    measured, covered = np.ones(SHAPE, bool), np.ones(SHAPE, bool)
    measured[:50], covered[:20], covered[100] = False, False, False
    counts = count_ortho(scene(texture(), texture(), measured=measured, covered=covered), WHOLE, np.zeros(SHAPE, int))
    assert counts.visible - counts.visible_covered == 21 * SHAPE[1]
    assert counts.visible_modelled == 150 * SHAPE[1] and counts.visible_modelled - counts.visible_modelled_covered == SHAPE[1]


def test_a_shift_beside_an_estimated_height_is_not_one_of_measured_ground():
    truth, measured = texture(), np.ones(SHAPE, bool)
    measured[100, 76] = False
    found = shifts(scene(truth, truth, measured=measured), WHOLE, np.ones(SHAPE, np.uint8))
    beside = np.maximum(np.abs(found.row - 100), np.abs(found.col - 76)) <= 12
    assert beside.any() and (found.measured == ~beside).all()


def rgba(colour) -> np.ndarray:
    return np.dstack([np.clip(np.rint(colour), 0, 255), np.full(SHAPE, 255)]).astype(np.uint8)


def test_the_fit_takes_away_brightness_and_psnr_is_what_is_left():
    truth = texture()
    noise = np.random.default_rng(2).normal(0, 3, truth.shape)
    ortho = rgba((truth - 12) / 1.1 + noise)
    ortho[:20, :, 3] = 0
    halves = [grey_sums(ortho[rows], truth[rows]) for rows in (slice(0, 90), slice(90, 200))]
    fit = fit_grey(tuple(halves))
    np.testing.assert_allclose(fit.gain, 1.1, atol=0.04)
    direct = 10 * np.log10(255**2 / ((fitted(ortho, fit) - truth)[20:] ** 2).mean())
    assert fit.psnr == pytest.approx(direct, abs=1e-3) and fit.psnr > fit.psnr_raw + 3
    assert fit.pixels == 180 * 220


def test_nothing_in_common_gives_no_figure():
    ortho = rgba(texture())
    ortho[..., 3] = 0
    assert fit_grey((grey_sums(ortho, texture()),)) == GreyFit()


def test_structural_similarity():
    grey = texture()[..., 0]
    valid = np.ones(SHAPE, bool)
    valid[100, 100] = False
    same = structural_similarity(grey, grey, valid)
    assert np.nanmin(same) == pytest.approx(1.0) and np.isnan(same[95:106, 95:106]).all() and np.isfinite(same[94, 100])
    noisy = grey + np.random.default_rng(0).normal(0, 20, SHAPE)
    assert np.nanmean(structural_similarity(noisy, grey, valid)) < 0.85


@pytest.mark.parametrize("move", [(0.0, 0.0), (0.4, -0.7), (-1.3, 0.25)])
def test_a_planted_shift_is_found(move):
    truth = texture()
    moved = np.dstack([shifted(truth[..., band], move[::-1], order=3, mode="nearest") for band in range(3)])
    found = shifts(scene(moved, truth), WHOLE, np.ones(SHAPE, np.uint8))
    good = np.isfinite(found.dx)
    assert good.sum() >= 15
    assert np.median(found.dx[good]) == pytest.approx(move[0], abs=0.03)
    assert np.median(found.dy[good]) == pytest.approx(move[1], abs=0.03)


def test_nodes_belong_to_one_tile_each():
    truth = texture()
    parts = [
        shifts(scene(truth, truth), core, np.ones(SHAPE, np.uint8)) for core in (Window(0, 0, 100, 220), Window(100, 0, 100, 220))
    ]
    whole = shifts(scene(truth, truth), WHOLE, np.ones(SHAPE, np.uint8))
    assert sum(len(part) for part in parts) == len(whole)


def roofed(second_roof: bool) -> OrthoScene:
    """A red roof, and its copy on the ground beside it when asked for."""
    truth, material = texture() * 0.3 + 70, np.full(SHAPE, Material.OPEN_GROUND, np.uint8)
    truth[60:100, 60:100] = (210, 60, 50)
    material[60:100, 60:100] = Material.ROOF
    colour = truth.copy()
    if second_roof:
        colour[60:100, 100:110] = (205, 64, 52)
    return scene(colour, truth, material)


def test_a_doubled_roof_is_found_and_an_honest_one_is_not():
    assert doubled(roofed(True))[60:100, 100:110].mean() > 0.95
    assert doubled(roofed(True)).sum() <= 400 and not doubled(roofed(False)).any()


def test_dirt_of_another_colour_is_no_doubled_roof():
    dirty = roofed(False)
    dirty.colour[120:130, 60:100] = 250
    assert not doubled(dirty).any()


def test_roofs_are_doubled_where_two_photographs_see_the_ground():
    picture = roofed(True)
    picture.seen[:] = 2
    hidden = np.ones(SHAPE, int)
    whole = count_ortho(picture, WHOLE, hidden)
    assert whole.shadow_doubled == doubled(picture).sum() > 0
    picture.seen[:, 105:] = 1
    half = count_ortho(picture, WHOLE, hidden)
    assert half.shadow_doubled == doubled(picture)[:, :105].sum() < whole.shadow_doubled and half.shadow < whole.shadow


def test_a_second_roof_apart_from_the_first_is_no_displaced_edge():
    picture = roofed(True)
    picture.seen[:] = 2
    counts = count_ortho(picture, WHOLE, np.ones(SHAPE, int))
    touching = doubled(picture)[:, 100].sum()
    assert touching > 0 and counts.shadow_doubled_apart == counts.shadow_doubled - touching > 0


@pytest.mark.parametrize(("material", "code"), [(Material.VEHICLE, PlaceClass.VEHICLE), (Material.WATER, PlaceClass.WATER)])
def test_nodes_know_of_cars_and_water_in_their_window(material, code):
    truth = texture()
    materials = np.full(SHAPE, Material.OPEN_GROUND, np.uint8)
    materials[64 + 12, 96 - 12] = materials[64 + 13, 128] = material
    found = shifts(scene(truth, truth, materials), WHOLE, np.full(SHAPE, PlaceClass.CLEAR_GROUND, np.uint8))
    place = {(int(r), int(c)): p for r, c, p in zip(found.row, found.col, found.place, strict=True)}
    assert place[64, 96] == code and place[64, 128] == PlaceClass.CLEAR_GROUND


def test_counts_of_roads_shadows_and_visibility():
    truth = texture()
    material = np.full(SHAPE, Material.OPEN_GROUND, np.uint8)
    material[50:60] = Material.ROAD
    colour = truth.copy()
    colour[50:60, 20:25] += 90
    picture = scene(colour, truth, material)
    picture.seen[:, 110:] = 2
    picture.seen[:10] = 0
    picture.covered[190:] = False
    counts = count_ortho(picture, WHOLE, np.zeros(SHAPE, int))
    assert (counts.road_3, counts.road_3_far, counts.road_fewer, counts.road_fewer_far) == (1100, 50, 1100, 0)
    assert counts.hidden == counts.hidden_covered == 10 * 220
    assert counts.visible == 190 * 220 and counts.visible_covered == 180 * 220
    halves = [count_ortho(picture, core, np.zeros(SHAPE, int)) for core in (Window(0, 0, 77, 220), Window(77, 0, 123, 220))]
    merged = merged_counts(tuple(halves))
    assert merged.model_dump() == pytest.approx(counts.model_dump())
