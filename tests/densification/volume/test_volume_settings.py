"""Every setting of the height volume changes what it says it changes."""

import numpy as np
from textured_box import SURFACE, photos, pyramid, scene_block

from orthomill.tasks.densification.volume.levels import VolumeScene
from orthomill.tasks.densification.volume.quality import Band
from orthomill.tasks.densification.volume.volume_tile import SolvedVolume, solve_volume, volume_tiles
from orthomill.tasks.matching.volume.height_volume import comparison_of, ranges_of
from orthomill.tasks.matching.volume.paths import UNIT
from orthomill.tasks.matching.volume.volume_settings import HeightVolume


def finest(settings: HeightVolume, coarser: float = 0.0) -> SolvedVolume:
    """The finest level with a flat coarser one of the height `coarser`."""
    scene = VolumeScene(scene_block(), photos(), SURFACE, settings)
    tile = volume_tiles(scene.levels[-1], scene)[0]
    pixels = tuple(pyramid(part.name)[part.level][part.window.slices] for part in tile.photos)
    shape = (tile.coarser.height, tile.coarser.width)
    terrain = np.zeros(tile.places.shape, np.float32)
    return solve_volume(tile, settings, scene.block, pixels, terrain, np.full(shape, coarser, np.float32))


def test_coherence_depends_on_what_goes_along():
    loose, strict = finest(HeightVolume(widest=32)), finest(HeightVolume(widest=32, coherence=0.2, coherence_slope=0.0))
    sloped = finest(HeightVolume(widest=32, coherence=0.2, coherence_slope=1.0))
    assert (
        strict.quality[..., Band.COHERENCE].mean() < loose.quality[..., Band.COHERENCE].mean()
        and strict.quality[..., Band.COHERENCE].mean() < sloped.quality[..., Band.COHERENCE].mean()
    )
    assert np.array_equal(strict.height, loose.height, equal_nan=True)


def test_oversampling_makes_heights_finer():
    inner = slice(20, 45), slice(20, 45)
    rough, fine = (finest(HeightVolume(widest=32, oversampling=n)).height[inner] for n in (1, 3))
    assert abs(fine).mean() < 0.8 * abs(rough).mean()


def test_a_wider_spacing_looks_farther_around_a_cell():
    fine, wide = (finest(HeightVolume(widest=32, spacing=spacing)) for spacing in (1, 4))
    # What looks farther is blunter: heights farther apart cost nearly the same.
    assert 1.5 * fine.quality[..., Band.SPREAD].mean() < wide.quality[..., Band.SPREAD].mean()


def test_few_photographs_are_compared_although_more_are_counted():
    few, all_four = finest(HeightVolume(widest=32, compared=2)), finest(HeightVolume(widest=32, compared=4))
    assert few.quality[..., Band.SEEN].max() == all_four.quality[..., Band.SEEN].max() == 4
    assert not np.array_equal(few.height, all_four.height, equal_nan=True)


def test_the_margin_is_how_far_a_height_may_lie_from_the_coarser_one():
    near, far = (finest(HeightVolume(widest=32, margin=margin), coarser=14.0).height[20:40, 20:40] for margin in (1, 20))
    assert np.median(near) > 3 and abs(np.median(far)) < 1


def test_less_doubt_leaves_fewer_rivals():
    few, many = (finest(HeightVolume(widest=32, doubt=doubt)) for doubt in (0.02, 0.3))
    assert few.quality[..., Band.SPREAD].mean() < 0.5 * many.quality[..., Band.SPREAD].mean()
    assert np.array_equal(few.height, many.height, equal_nan=True)


def test_rules_follow_the_settings():
    settings = HeightVolume(margin=3, reach=2, most_heights=40, mean_heights=20, compared=3, best_share=0.4, blank=0.3)
    ranges, comparison = ranges_of(settings), comparison_of(settings)
    assert (ranges.margin, ranges.reach, ranges.most, ranges.mean) == (3, 2, 48, 32) and ranges.most % UNIT == 0
    assert (comparison.most, comparison.share, comparison.blank) == (3, 0.4, 0.3)
