"""What tiles add up to, in any cut; and blended colours as pixels, beside a plain NumPy twin."""

import numpy as np
import pytest

from orthomill.tasks.colouring.blending.blending import Blend, Blended, blend
from orthomill.tasks.colouring.blending.colour_sums import ColourSums, ColourTally, sum_of
from orthomill.tasks.colouring.blending.painting import rgba
from orthomill.tasks.colouring.blending.rejection import Rejection

NAMES = ("a", "b", "c", "d")


def blended(rows: slice = slice(None), bands: int = 3) -> Blended:
    """Four photographs of 12 x 9 pixels, some of which see nothing and some of which disagree."""
    rng = np.random.default_rng(5)
    colours = rng.uniform(-30, 290, (4, 12, 9, bands)).astype(np.float32)
    weights = (rng.uniform(1, 2, (4, 12, 9)) * (rng.uniform(0, 1, (4, 12, 9)) < 0.6)).astype(np.float32)
    return blend(colours[:, rows], weights[:, rows], Blend(Rejection("mean", 1.0, 12.0)))


def sums(*parts: Blended) -> ColourSums:
    tally = ColourTally(np.zeros(4))
    for part in parts:
        tally.add(part)
    return tally.sums(NAMES, np.concatenate([part.seen for part in parts]))


def test_strips_and_tiles_add_up_to_the_whole():
    whole = sums(blended())
    strips = blended(slice(0, 5)), blended(slice(5, 12))
    for parts in (sums(*strips), sum_of(map(sums, strips))):
        assert (parts.seen, parts.values, parts.rejected) == (whole.seen, whole.values, whole.rejected)
        assert parts.difference == pytest.approx(whole.difference, rel=1e-12)
        assert parts.shares == pytest.approx(whole.shares, rel=1e-12)
    assert sum(whole.seen) == 12 * 9 and whole.rejected > 0
    assert sum(whole.shares.values()) == pytest.approx((blended().used > 0).sum(), rel=1e-5)


def test_without_two_photographs_anywhere_there_is_no_difference():
    nothing = ColourTally(np.zeros(4)).sums(NAMES, np.zeros(0, np.uint8))
    assert nothing.difference is None and sum_of([nothing, nothing]).difference is None
    assert sum_of([nothing, sums(blended())]).difference == sums(blended()).difference


@pytest.mark.parametrize("bands", [1, 3])
def test_pixels_are_rounded_and_kept_in_their_range(bands):
    made = blended(bands=bands)
    picture, known = rgba(made), made.used > 0
    expected = np.clip(np.floor(np.broadcast_to(made.colour, (12, 9, 3)) + 0.5), 0, 255).astype(np.uint8)
    assert np.array_equal(picture[known][:, :3], expected[known]) and (picture[known][:, 3] == 255).all()
    assert known.any() and not known.all() and not picture[~known].any()
    assert {0, 255} <= set(picture[known][:, 0].tolist())
