"""Epipolar images: what a pixel shows, that tiles make up the whole, and the jobs of the stage."""

from types import SimpleNamespace

import numpy as np
import pytest
from epipolar_projection import epipolar_pixels
from plain_resampling import sample_bilinear
from tiny_block import block, camera, photograph, photos, see, texture

from orthomill.schemas.epipolar import PAIRS, GreyRange
from orthomill.schemas.job import Job
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import RasterSpec, Window, tiles_of
from orthomill.schemas.stage_contract import NotYet
from orthomill.tasks.epipolar.epipolar_image import TileOfPair, photograph_range, resample_tile
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.selection import choose_pairs
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.geometry.normal_case import epipolar_shape
from orthomill.tasks.imagery.resampling import sample_cubic


def pair():
    return next(p for p in choose_pairs(block(), PairChoice(), 0.08).pairs if p.name == "a1-a2")


def tile_of(window, side="left", used=None):
    used = used or pair()
    return TileOfPair(used, side, block().of(used.left if side == "left" else used.right), camera(), window)


def image(side="left", bicubic=True):
    used = pair()
    tile = tile_of(Window(0, 0, *epipolar_shape(used, side)), side)
    window = Window(0, 0, 460, 480)
    return resample_tile(tile, window, bicubic, photograph(used.left if side == "left" else used.right)), tile


@pytest.mark.parametrize(("bicubic", "sample"), [(True, sample_cubic), (False, sample_bilinear)])
def test_the_kernel_agrees_with_numpy(bicubic, sample):
    out, tile = image(bicubic=bicubic)
    col, row = np.meshgrid(np.arange(out.shape[1], dtype=float), np.arange(out.shape[0], dtype=float))
    pixels = tile.view.to_photo(np.column_stack([col.ravel(), row.ravel()]))
    expected = np.nan_to_num(np.clip(sample(photograph("a1")[..., 0], pixels) + 0.5, 1, 255)).reshape(out.shape)
    assert (np.abs(out.astype(float) - np.floor(expected)) > 0).mean() < 1e-3
    assert np.abs(out - np.floor(expected)).max() <= 1
    assert ((out == 0) == (expected == 0)).all()


def test_both_images_show_the_same_ground():
    """The left image at a row shows what the right one shows on the same row, shifted by the true parallax."""
    (left, l_tile), (right, r_tile) = image("left"), image("right")
    random = np.random.default_rng(5)
    pixels = random.uniform(40, 300, (400, 2))
    ground = see(l_tile.view.view, l_tile.view.to_photo(pixels))
    other = epipolar_pixels(r_tile.view, ground)
    inside = (other > 8).all(axis=1) & (other[:, 0] < right.shape[1] - 8) & (other[:, 1] < right.shape[0] - 8)
    truth = texture(ground[:, 0], ground[:, 1])
    for side, at in ((left, pixels), (right, other)):
        seen = sample_cubic(side, at[inside])
        assert np.sqrt(((seen - truth[inside]) ** 2).mean()) < 4
    assert np.abs(other[inside, 1] - pixels[inside, 1]).max() < 1e-6


def test_what_the_photograph_masks_is_outside():
    whole, tile = image()
    mask = np.full((460, 480, 1), 255, np.uint8)
    mask[100:200, 150:300] = 0
    seen = resample_tile(tile, Window(0, 0, 460, 480), True, np.concatenate([photograph("a1"), mask], axis=2))
    col, row = np.meshgrid(np.arange(whole.shape[1], dtype=float), np.arange(whole.shape[0], dtype=float))
    places = tile.view.to_photo(np.column_stack([col.ravel(), row.ravel()])).reshape(*whole.shape, 2)
    in_mask = (np.abs(places - [224.5, 149.5]) < [75.0, 50.0]).all(axis=-1)
    clear = (np.abs(places - [224.5, 149.5]) > [78.0, 53.0]).any(axis=-1)
    assert in_mask.sum() > 5000 and (seen[in_mask] == 0).all() and np.array_equal(seen[clear], whole[clear])


@pytest.mark.parametrize("size", [64, 100, 256])
def test_tiles_make_up_the_whole(size):
    whole, _ = image()
    out = np.zeros_like(whole)
    for tile in tiles_of(whole.shape, size):
        part = tile_of(tile.window)
        window = part.view.photo_window(tile.window)
        out[tile.window.slices] = resample_tile(part, window, True, None if window.empty else photograph("a1")[window.slices])
    np.testing.assert_array_equal(out, whole)


def test_sixteen_bits_and_colours():
    whole, tile = image()
    window = Window(0, 0, 460, 480)
    colour = np.repeat(photograph("a1"), 3, axis=2)
    assert np.abs(resample_tile(tile, window, True, colour).astype(int) - whole).max() <= 1
    deep = photograph("a1").astype(np.uint16) * 100
    scaled = resample_tile(tile, window, True, deep, GreyRange(low=0, high=25500))
    assert np.abs(scaled.astype(int) - whole).max() <= 1
    assert 0 < photograph_range(deep).low < photograph_range(deep).high < 25501


def test_outside_is_zero_and_inside_never():
    used = pair()
    assert not resample_tile(tile_of(Window(0, 0, 64, 64)), Window(0, 0, 0, 0), True).any()
    black = np.zeros((460, 480, 1), np.uint8)
    tile = tile_of(Window(100, 100, 64, 64), used=used)
    assert (resample_tile(tile, Window(0, 0, 460, 480), True, black) == 1).all()


class FakeView:
    """What the stage may ask while it plans."""

    project = SimpleNamespace(tile=128, grid=MapSurface())

    def __init__(self, tables):
        self.tables = tables

    def table(self, table):
        if table.path not in self.tables:
            raise NotYet(table.path)
        return self.tables[table.path]

    def raster(self, name):
        return RasterSpec(name=name, shape=(115, 120, 1), dtype="uint16", chunk=128)


def planned(view):
    made = []
    try:
        for thing in EpipolarStage().plan(view):
            made.append(thing)
    except NotYet:
        pass
    return made


def test_the_stage_plans_in_two_steps():
    first = planned(FakeView({}))
    assert [job.item for job in first] == ["pairs", "report"]
    tables = {PAIRS.path: choose_pairs(block(), PairChoice(), 0.08), BLOCK.path: block(), PHOTOS.path: photos()}
    second = planned(FakeView(tables))
    specs = {s.name: s for s in second if isinstance(s, RasterSpec)}
    jobs = [j for j in second if isinstance(j, Job) and j.function is resample_tile]
    assert len(specs) == 2 * len(tables[PAIRS.path].pairs)
    for spec in specs.values():
        assert sum(j.writes["image"].name == spec.name for j in jobs) == len(list(tiles_of(spec.shape, 128)))
    assert len({job.key for job in second if isinstance(job, Job)}) == sum(isinstance(j, Job) for j in second)
    job = next(j for j in jobs if "pixels" in j.reads)
    out = job.function(pixels=photograph(job.params["tile"].orientation.photo)[job.reads["pixels"].window.slices], **job.params)
    assert out.shape == job.writes["image"].window.shape and out.dtype == np.uint8


def test_sixteen_bit_photographs_get_one_stretch():
    sixteen = tuple(p.model_copy(update={"dtype": "uint16", "levels": 3}) for p in photos().photos)
    deep = photos().model_copy(update={"photos": sixteen})
    tables = {PAIRS.path: choose_pairs(block(), PairChoice(), 0.08), BLOCK.path: block(), PHOTOS.path: deep}
    jobs = [j for j in planned(FakeView(tables)) if isinstance(j, Job)]
    assert sum(j.item.startswith("grey-") for j in jobs) == 6
    assert all("stretch" in j.reads for j in jobs if j.function is resample_tile and "pixels" in j.reads)
