"""Colours, worth, radiometry and whole tiles on the box scene."""

from dataclasses import replace
from math import inf

import cv2
import numpy as np
import pytest
from box_scene import BOX, CENTRES, DSM, ORTHO, block, heights, sees, true_ortho, view
from box_scene_stages import GAINS, VIGNETTING, photograph

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.schemas.surface import HeightSource, Provenance
from orthomill.tasks.colouring.balance.balancing import balanced_block
from orthomill.tasks.colouring.balance.photo_radiometry import PhotoRadiometry, Radiometry, corrected
from orthomill.tasks.colouring.balance.radiometric_balance import balance_block
from orthomill.tasks.colouring.balance.shared_ground import Samples
from orthomill.tasks.colouring.blending.blending import Blend
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.blending.rejection import Rejection
from orthomill.tasks.colouring.sampling.ground_sampling import Ground, ground_of, sample_photo
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt
from orthomill.tasks.geometry.photograph_part import PhotoSource, level_window, photo_level
from orthomill.tasks.texture.ground.draping import BLOCK, block_heights
from orthomill.tasks.texture.ground.extent import ortho_grid, tile_extent
from orthomill.tasks.texture.ground.gentle_ground import gentle_ground
from orthomill.tasks.texture.ground.relief import ReliefMap, tile_relief
from orthomill.tasks.texture.mosaic import TextureRules, sample_tile, texture_tile

WHOLE = Window(0, 0, 240, 240)
RULES = TextureRules(
    tolerance=0.3,
    bridge=24,
    drape_reach=0.0,
    widening_margin=1.0,
    widening_ramp=2.0,
    sharpen=True,
    colours=ColourRules(0.15, Blend(Rejection("mean", 1.0, 12.0))),
)
SOURCES = [PhotoSource(view(name), 0, (420, 420, 3)) for name in CENTRES]


def relief(model: np.ndarray, ground: np.ndarray | None = None) -> ReliefMap:
    return ReliefMap(tile_relief(model, Window(0, 0, *DSM.shape), ground), DSM)


@pytest.fixture(scope="module")
def photos() -> dict[str, np.ndarray]:
    return {name: photograph(name) for name in CENTRES}


@pytest.fixture(scope="module")
def radiometry(photos) -> Radiometry:
    extent = tile_extent(relief(heights()), ORTHO, WHOLE, SOURCES, RULES.halo)
    pixels = tuple(photos[part.name][part.window.slices] for part in extent.photos)
    samples = sample_tile(heights()[extent.heights.slices], block(), pixels, extent, RULES, 4)
    return balanced_block((samples,), block(), False, "block", True)


def make(
    photos,
    radiometry,
    tile: int = 240,
    rules: TextureRules = RULES,
    model: np.ndarray | None = None,
    sources=SOURCES,
    provenance=None,
    precision=0.0,
):
    """The whole orthoimage from tiles: rasters by name, and the statistics of the tiles."""
    model = heights() if model is None else model
    codes = np.full(DSM.shape, Provenance.AGREED, np.uint8) if provenance is None else provenance
    ground = gentle_ground(*block_heights(model, np.full_like(model, precision), DSM.cell), BLOCK * DSM.cell)
    shape = relief(model, ground)
    rasters, statistics = {}, []
    for t in tiles_of(ORTHO.shape, tile):
        extent = tile_extent(shape, ORTHO, t.window, sources, rules.halo, rules.around)
        pixels = tuple(photos[part.name][part.window.slices] for part in extent.photos)
        own, blocks = model[extent.heights.slices], ground[extent.ground.slices]
        cells = own, np.full_like(own, precision), codes[extent.heights.slices]
        result = texture_tile(*cells, block(), radiometry, pixels, extent, rules, blocks)
        statistics.append(result.statistics)
        for name, values in zip(("ortho", "coverage", "rejected", "height_source", "source"), result, strict=False):
            rasters.setdefault(name, np.zeros((*ORTHO.shape, *values.shape[2:]), values.dtype))[t.window.slices] = values
    return rasters, statistics


@pytest.fixture(scope="module")
def ortho(photos, radiometry):
    return make(photos, radiometry)


def near(rectangle, metres: float) -> np.ndarray:
    """Ortho pixels within `metres` of a rectangle (west, east, south, north)."""
    x, y = ORTHO.centres(WHOLE)
    w, e, s, n = rectangle
    return ((x > w - metres) & (x < e + metres))[None, :] & ((y > s - metres) & (y < n + metres))[:, None]


def test_bicubic_reproduces_a_ramp(record_property):
    photo = view("b")
    col, row = np.meshgrid(np.arange(420.0), np.arange(420.0))
    ramp = (3.0 + 0.25 * col + 0.4 * row).astype(np.float32)[..., None]
    window = Window(100, 100, 40, 40)
    ground = ground_of(heights(), Window(0, 0, 120, 120), DSM, ORTHO, window)
    sampled = sample_photo(photo, PhotoPixelsAt(ramp, Window(0, 0, 420, 420), 0), ground, np.ones((40, 40), np.uint8), 0.0)
    x, y = ORTHO.centres(window)
    pixels = photo.project(np.column_stack([*(a.ravel() for a in np.meshgrid(x, y)), ground.z.ravel()]))
    expected = 3.0 + 0.25 * pixels[:, 0] + 0.4 * pixels[:, 1]
    worst = np.abs(sampled.colour[..., 0].ravel() - expected).max()
    record_property("found", f"{worst:.1e} grey levels at most")
    assert worst < 2e-4


@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (0.4, 0.0), (-0.3, 0.5)])
def test_worth_is_the_projected_area_of_the_surface_element(dx, dy):
    photo = view("a")
    plain = replace(photo, camera=photo.camera.changed(k1=0.0, k2=0.0))
    grid, shape = MapGrid(west=50.0, north=60.0, cell=0.2, rows=3, cols=3), (3, 3)
    z = np.full(shape, 5.0, np.float32)
    ground = Ground(grid, Window(0, 0, 3, 3), z, np.full(shape, dx, np.float32), np.full(shape, dy, np.float32))
    pixels = PhotoPixelsAt(np.zeros((420, 420, 1), np.uint8), Window(0, 0, 420, 420), 0)
    weight = sample_photo(plain, pixels, ground, np.ones(shape, np.uint8), 0.0).weight
    x, y = grid.centres(ground.window)
    corners = np.array(
        [[x[1] + sx * 0.1, y[1] + sy * 0.1, 5.0 + dx * sx * 0.1 + dy * sy * 0.1] for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )
    c, r = plain.project(corners).T
    area = 0.5 * abs(sum(c[i] * r[(i + 1) % 4] - c[(i + 1) % 4] * r[i] for i in range(4)))
    assert weight[1, 1] == pytest.approx(area, rel=1e-3)


def test_radiometry_finds_gain_offset_and_vignetting(radiometry):
    mean_gain = np.mean([gain for gain, _ in GAINS.values()])
    for photo in radiometry.photos:
        gain, offset = GAINS[photo.photo]
        np.testing.assert_allclose(photo.gain, gain / mean_gain, atol=0.02)
        np.testing.assert_allclose(np.add(photo.v1, photo.v2), -VIGNETTING, atol=0.06)
        assert np.abs(np.subtract(photo.offset, offset)).max() < 4.0
    assert radiometry.difference_after < 0.25 * radiometry.difference_before


def test_radiometry_is_not_moved_by_gross_errors():
    rng = np.random.default_rng(5)
    ground = rng.uniform(40, 200, 600)
    point, photo = np.repeat(np.arange(600), 3), np.tile(np.arange(3), 600).astype(np.int32)
    gain, offset = np.array([1.1, 1.0, 0.9]), np.array([5.0, 0.0, -5.0])
    grey = gain[photo] * ground[point] + offset[photo] + rng.normal(0, 1, 1800)
    grey[rng.random(1800) < 0.05] += 60
    columns = [grey.clip(4, 250).astype(np.float32)] * 3
    result = balance_block(("a", "b", "c"), Samples(point, photo, np.zeros(1800, np.float32), *columns), 255.0, False)
    np.testing.assert_allclose([p.gain[0] for p in result.photos], gain, atol=0.015)
    np.testing.assert_allclose([p.offset[0] for p in result.photos], offset, atol=2.0)


def test_photos_without_common_ground_stay_as_they_are():
    empty = Samples(np.zeros(0, np.int64), np.zeros(0, np.int32), *(np.zeros(0, np.float32) for _ in range(4)))
    result = balance_block(("a", "b"), empty, 255.0, True)
    assert result.photos == (PhotoRadiometry(photo="a"), PhotoRadiometry(photo="b"))
    grey = np.full((2, 2, 3), 77.0, np.float32)
    assert (corrected(grey, np.ones((2, 2)), result.photos[0]) == 77).all()


def test_the_orthoimage_is_the_true_one(ortho):
    rasters, _ = ortho
    colour, alpha = rasters["ortho"][..., :3].astype(float), rasters["ortho"][..., 3] > 0
    away = alpha & ~(near(BOX[:4], 1.0) & ~near(BOX[:4], -1.0))
    error = np.abs(colour - true_ortho()).mean(axis=-1)
    assert alpha.mean() > 0.995
    assert error[away].mean() < 2.0 and error[away].max() < 20.0


def test_the_roof_is_not_projected_twice(ortho):
    rasters, _ = ortho
    red = (rasters["ortho"][..., 0] > 150) & (rasters["ortho"][..., 1] < 90) & (rasters["ortho"][..., 3] > 0)
    assert not red[~near(BOX[:4], 0.6)].any()
    assert red[near(BOX[:4], -1.0)].all()


def test_without_the_visibility_test_it_would_be(photos, radiometry):
    red_outside = {}
    for tolerance in (0.3, 1000.0):
        rasters, _ = make(photos, radiometry, rules=replace(RULES, tolerance=tolerance), sources=SOURCES[:1])
        red = (rasters["ortho"][..., 0] > 150) & (rasters["ortho"][..., 1] < 90)
        red_outside[tolerance] = red[~near(BOX[:4], 0.6)].sum()
    assert red_outside[0.3] == 0 and red_outside[1000.0] > 50


@pytest.mark.parametrize("centre", ["mean", "median", "deviation"])
def test_vehicles_are_suppressed(photos, radiometry, centre):
    rules = replace(RULES, colours=ColourRules(0.15, Blend(Rejection(centre, 3.0 if centre == "deviation" else 1.0, 12.0))))
    rasters, statistics = make(photos, radiometry, rules=rules)
    for place in ((80, 85, 30, 33), (30, 35, 90, 93), (38, 43, 90, 93)):
        where = near(place, 1.0)
        assert np.abs(rasters["ortho"][..., :3][where] - true_ortho()[where]).max() < 40
        assert (rasters["rejected"][near(place, -0.6)] == 1).all()
    assert statistics[0].colours.rejected < 0.01 * statistics[0].colours.values


def test_vehicles_stay_without_rejection(photos, radiometry):
    rasters, _ = make(photos, radiometry, rules=replace(RULES, colours=ColourRules(0.15, Blend(Rejection("none")))))
    where = near((30, 35, 90, 93), -0.6)
    assert np.abs(rasters["ortho"][..., :3][where] - true_ortho()[where]).mean() > 10


@pytest.mark.parametrize("tile", [64, 100])
@pytest.mark.parametrize("reach", [0.0, 3.0, inf])
def test_tiles_give_bit_for_bit_what_one_tile_gives(photos, radiometry, tile, reach):
    noisy = heights() + np.random.default_rng(8).normal(0, 0.2, DSM.shape).astype(np.float32)
    noisy[20:23, 30:36] = noisy[70:110, 25:90] = np.nan
    codes = np.where(np.arange(120)[:, None] % 20 < 9, Provenance.INCOHERENT, Provenance.AGREED).repeat(120, 1)
    rules = replace(RULES, drape_reach=reach)
    one, _ = make(photos, radiometry, model=noisy, rules=rules, provenance=codes)
    many, _ = make(photos, radiometry, tile, model=noisy, rules=rules, provenance=codes)
    for name, values in one.items():
        assert np.array_equal(values, many[name]), name


def test_coverage_counts_sum_to_all_pixels(ortho):
    rasters, statistics = ortho
    assert sum(statistics[0].colours.seen) == statistics[0].pixels == 240 * 240
    assert (rasters["coverage"] >= 1).sum() == (rasters["ortho"][..., 3] > 0).sum()
    assert statistics[0].colours.seen[3] == (rasters["coverage"] >= 3).sum()


def test_holes_stay_open_or_are_draped(photos, radiometry):
    holed = heights()
    holed[90:96, 20:30] = np.nan
    place = np.s_[182:190, 42:58]
    left, _ = make(photos, radiometry, model=holed)
    draped, statistics = make(photos, radiometry, model=holed, rules=replace(RULES, drape_reach=inf))
    assert (left["ortho"][place][..., 3] == 0).all() and (left["height_source"][place] == HeightSource.NONE).all()
    assert (draped["height_source"][place] == HeightSource.DRAPED).all() and statistics[0].heights[
        HeightSource.DRAPED
    ] == 6 * 10 * 4
    assert np.abs(draped["ortho"][place][..., :3] - true_ortho()[place]).max() < 20


def test_holes_are_draped_as_far_as_the_reach(photos, radiometry):
    holed = heights()
    holed[80:101, 20:41] = np.nan
    rasters, _ = make(photos, radiometry, model=holed, rules=replace(RULES, drape_reach=3.0))
    source = rasters["height_source"][1::2, 1::2]
    assert (source[80:83, 20:41] == HeightSource.DRAPED).all() and (source[83:98, 23:38] == HeightSource.NONE).all()


def test_without_limit_every_pixel_that_a_photo_shows_has_a_colour(photos, radiometry):
    """Half of the model is missing, its border included: all of it is painted up to the borders of the photos."""
    holed = heights()
    holed[:, :45] = np.nan
    rasters, (statistics,) = make(photos, radiometry, model=holed, rules=replace(RULES, drape_reach=inf))
    assert statistics.missed == 0 and statistics.heights[HeightSource.NONE] == 0
    assert statistics.outside + statistics.hidden == (rasters["ortho"][..., 3] == 0).sum()
    x, y = np.meshgrid(*ORTHO.centres(WHOLE))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    shows = np.any([view(name).contains(view(name).project(points)) for name in CENTRES], axis=0).reshape(x.shape)
    far = ~near(BOX[:4], 12.0)
    np.testing.assert_array_equal((rasters["ortho"][..., 3] > 0)[far], shows[far])


def test_pixels_left_open_are_counted_as_missed(photos, radiometry):
    holed = heights()
    holed[90:96, 20:30] = np.nan
    _, (statistics,) = make(photos, radiometry, model=holed)
    assert statistics.missed == 6 * 10 * 4


def test_pixels_beyond_the_area_are_none_that_the_orthoimage_lacks(photos, radiometry):
    west, north = DSM.west, DSM.north
    half = 0.5 * DSM.cols * DSM.cell
    ring = ((west, north), (west + half, north), (west + half, north - 2 * half), (west, north - 2 * half))
    own = np.where(np.arange(DSM.cols) < DSM.cols // 2, heights(), np.float32(np.nan))
    _, statistics = make(photos, radiometry, rules=replace(RULES, wanted=WantedArea(polygons=((ring,),))), model=own)
    assert sum(tile.missed for tile in statistics) == 0
    assert sum(tile.outside for tile in statistics) > 0.49 * WHOLE.height * WHOLE.width, "but for pixels on its border"


def test_estimated_heights_are_told_from_measured_ones(photos, radiometry):
    codes = np.full(DSM.shape, Provenance.VOLUME, np.uint8)
    codes[:10], codes[10:20] = Provenance.INCOHERENT, Provenance.INTERPOLATED
    rasters, (statistics,) = make(photos, radiometry, provenance=codes)
    source = rasters["height_source"]
    assert (source[:40] == HeightSource.ESTIMATED).all() and (source[40:] == HeightSource.MEASURED).all()
    assert statistics.heights == (0, 200 * 240, 0, 40 * 240)


def test_where_only_an_estimate_hides_the_ground_it_has_its_colour(photos, radiometry, ortho):
    """A slab that is not there stands before the ground of every photo: measured it hides it, estimated it does not."""
    wrong, codes = heights(), np.full(DSM.shape, Provenance.AGREED, np.uint8)
    slab = np.zeros(DSM.shape, bool)
    # A frame around cells of ground, as high as the photos are far: no ray comes in.
    slab[84:103, 14:33] = True
    slab[90:97, 20:27] = False
    wrong[slab] = 60.0
    inside = np.s_[184:190, 44:50]
    hidden, (statistics,) = make(photos, radiometry, model=wrong, provenance=codes)
    assert (hidden["ortho"][inside][..., 3] == 0).all()
    codes[slab] = Provenance.INCOHERENT
    shown, (honest,) = make(photos, radiometry, model=wrong, provenance=codes)
    assert np.abs(shown["ortho"][inside][..., :3] - true_ortho()[inside]).max() < 20
    assert honest.hidden == ortho[1][0].hidden < statistics.hidden


def test_noise_of_measured_heights_leaves_no_specks(photos, radiometry):
    """Single cells that are too low lie behind their neighbours in every photo: their standard errors give them a colour."""
    rough = heights()
    rough[84:103:3, 14:33:3] -= 4.0
    pits = np.s_[168:206, 28:66]
    certain, _ = make(photos, radiometry, model=rough)
    noisy, _ = make(photos, radiometry, model=rough, precision=1.5)
    assert (certain["ortho"][pits][..., 3] == 0).mean() > 0.03
    assert (noisy["ortho"][pits][..., 3] == 255).all()


def test_a_photo_behind_an_estimate_serves_only_where_no_other_sees_the_place(photos, radiometry):
    """An estimated wall on the true roof stands before photo a alone: the blend is that of the others."""
    wrong, codes = heights(), np.full(DSM.shape, Provenance.AGREED, np.uint8)
    wrong[20:24, 38:40], codes[20:24, 38:40] = 8.0, Provenance.INTERPOLATED
    behind = np.s_[42:46, 80:81]
    rasters, _ = make(photos, radiometry, model=wrong, provenance=codes)
    others, _ = make(
        {name: np.where(name == "a", 0, pixels).astype(np.uint8) for name, pixels in photos.items()},
        radiometry,
        model=wrong,
        provenance=codes,
    )
    np.testing.assert_array_equal(rasters["ortho"][behind], others["ortho"][behind])


def test_grey_photos_of_16_bits_give_a_grey_orthoimage(photos):
    deep = {name: (pixels[..., 1:2].astype(np.uint16) * 100) for name, pixels in photos.items()}
    extent = tile_extent(relief(heights()), ORTHO, WHOLE, SOURCES, RULES.halo)
    pixels = tuple(deep[part.name][part.window.slices] for part in extent.photos)
    samples = sample_tile(heights()[extent.heights.slices], block(), pixels, extent, RULES, 6)
    found = balanced_block((samples,), block(), True, "block", True)
    assert 14000 < found.white < 30000
    rasters, _ = make(deep, found)
    colour = rasters["ortho"][..., :3].astype(float)
    assert (colour[..., 0] == colour[..., 2]).all()
    assert np.corrcoef(colour[:100, :, 0].ravel(), true_ortho()[:100, :, 1].ravel())[0, 1] > 0.98
    whole, _ = make(deep, found, rules=replace(RULES, bits=16))
    fine, coarse = whole["ortho"], rasters["ortho"]
    assert fine.dtype == np.uint16 and (fine[..., 3] == coarse[..., 3].astype(np.uint16) * 257).all()
    assert np.abs(fine[..., :3] / 257.0 - coarse[..., :3]).max() <= 0.5, "the same picture"
    assert len(np.unique(fine[..., 0])) > 300, "with more than 256 grey values"


def test_the_ortho_grid_nests():
    grid = ortho_grid(DSM, None, 0.65)
    assert grid.cell == 0.5 and grid.rows == 240 and grid.west == DSM.west
    assert ortho_grid(DSM, None, 1.3).cell == 1.0 and ortho_grid(DSM, 0.25, 0.65).cell == 0.25
    with pytest.raises(WorkflowError, match=r"0\.3 m.*use 0\.333333 m or auto"):
        ortho_grid(DSM, 0.3, 0.65)


def test_pyramid_levels_follow_the_ortho_pixel():
    assert [photo_level(cell, 0.1, 4) for cell in (0.05, 0.1, 0.19, 0.4, 10.0)] == [0, 0, 1, 2, 3]
    assert level_window(Window(7, 8, 10, 11), 2, (105, 105)) == Window(1, 2, 4, 3)


def test_of_two_colours_the_one_at_a_break_of_the_depth_goes_in_any_tiling(photos, radiometry):
    """A model whose box is a cell too narrow: photographs show its rim where the ground should be, next to what the box hides."""
    narrow = np.where(cv2.erode(heights(), np.ones((3, 3))) > 0, heights(), np.float32(0.0))
    plain = replace(RULES, widening_margin=0.0, widening_ramp=0.0, sharpen=False)
    two = replace(plain, colours=ColourRules(0.15, Blend(Rejection("none"), two_limit=24.0), breaks=True))
    pair = [source for source in SOURCES if source.view.name in "ac"]
    both, _ = make(
        photos, radiometry, rules=replace(plain, colours=ColourRules(0.15, Blend(Rejection("none")))), model=narrow, sources=pair
    )
    chosen, _ = make(photos, radiometry, rules=two, model=narrow, sources=pair)
    changed = (both["ortho"] != chosen["ortho"]).any(axis=2)
    assert changed.any() and (both["coverage"][changed] == 2).all()
    error = [np.abs(one["ortho"][..., :3] - true_ortho()).mean(axis=2)[changed].mean() for one in (both, chosen)]
    assert error[1] < error[0]
    tiled, _ = make(photos, radiometry, 60, rules=two, model=narrow, sources=pair)
    assert np.array_equal(tiled["ortho"], chosen["ortho"])


def test_a_tile_that_no_photograph_shows_is_empty(photos, radiometry):
    rasters, statistics = make(photos, radiometry, sources=[])
    assert not rasters["coverage"].any() and not rasters["ortho"].any()
    assert [one.photo_seen for one in statistics] == [{}]


def test_the_heaviest_photograph_of_a_pixel_is_one_that_sees_it(ortho):
    source, coverage = ortho[0]["source"], ortho[0]["coverage"]
    assert np.array_equal(source > 0, ortho[0]["ortho"][..., 3] > 0) and source.max() <= len(CENTRES)
    assert len(np.unique(source[coverage > 1])) > 1
    x, y = ORTHO.centres(WHOLE)
    points = np.column_stack([*(a.ravel() for a in np.meshgrid(x, y)), heights(ORTHO).ravel()])
    seen = np.zeros(source.size, bool)
    for number, name in enumerate(block().names, 1):
        mine = source.ravel() == number
        seen[mine] = sees(view(name), points[mine])
    assert seen[source.ravel() > 0].mean() > 0.98, "but for the edges of the box"


def test_guesses_are_shown_by_the_steepest_photograph_and_sure_heights_by_all():
    grey = {name: 60 + 30 * k for k, name in enumerate(CENTRES)}
    plain = {name: np.full((420, 420, 3), level, np.uint8) for name, level in grey.items()}
    alike = Radiometry(photos=tuple(PhotoRadiometry(photo=name) for name in CENTRES))
    rules = replace(RULES, colours=ColourRules(0.15, Blend(Rejection("none"))))
    flat = np.zeros_like(heights())
    x, y = np.meshgrid(*ORTHO.centres(WHOLE))
    moved = np.stack([20.0 / ORTHO.cell * np.hypot(x - east, y - north) / up for east, north, up in CENTRES.values()]) ** 2
    steepest = np.array(list(grey.values()))[moved.argmin(axis=0)]
    first, second = np.sort(moved, axis=0)[:2]
    clear = second - first > 10
    shares = []
    for precision in (0.001, 20.0):
        rasters, _ = make(plain, alike, rules=rules, model=flat, precision=precision)
        shares.append((np.abs(rasters["ortho"][..., 0] - steepest.astype(float)) <= 2)[clear].mean())
    assert clear.mean() > 0.1 and shares[0] < 0.1 and shares[1] > 0.9
