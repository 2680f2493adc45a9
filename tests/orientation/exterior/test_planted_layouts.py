"""A few of the sixty layouts with planted blunders (all of them: make bench only=planted_layouts)."""

import numpy as np
import pytest
from orienting import orient
from photographed_layouts import LAYOUTS, layout, scene_of
from planted_blunders import is_named, named_by, nothing_else, planted, with_constant

from orthomill.tasks.orientation.relative.pairs import relate_pairs

SHORT = [("one_strip", "control at one end"), ("one_strip", "distances"), ("corridor", "control")]


def test_there_are_sixty_layouts():
    assert len(set(LAYOUTS)) == 60


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "knowledge"), SHORT, ids=[" ".join(one) for one in SHORT])
def test_planted_blunders_are_named_and_nothing_else(shape, knowledge):
    block = layout(shape, knowledge)
    relative = relate_pairs(block.photos, block.cameras, block.tie_points, 15)
    for one in planted(block, scene_of(shape, 0).distance, 0):
        # Relating a photograph of something else to all others takes as long as everything else here together.
        if one.kind == "photograph":
            continue
        out = orient(one.block, relative=relative if one.block.tie_points is block.tie_points else None)
        assert is_named(one, out), f"{one.kind}: {sorted(named_by(out))}, planted {sorted(one.named)}"
        assert nothing_else(one, out), f"{one.kind}: {sorted(named_by(out))}"
        assert out["block"].iterations <= 25


def test_a_calibrated_constant_that_is_wrong_is_named_although_its_prior_is_tight():
    """Positions of centimetres on a line tell the camera constant to a percent; a prior of half a pixel would hide a fifth."""
    one = with_constant(layout("one_strip", "good positions"), 1.2)
    out = orient(one.block)
    assert named_by(out) == {"cam"} and out["block"].cameras["cam"].c == pytest.approx(1150, rel=0.01)


def test_a_calibrated_constant_that_systematic_errors_pull_at_is_kept():
    """A third of a percent is what a rolling shutter does to a free constant; it is no other zoom."""
    one = with_constant(layout("one_strip", "good positions"), 1.003)
    assert not named_by(orient(one.block))


def test_one_wrong_ray_does_not_cost_the_right_ones():
    one = next(one for one in planted(layout("one_strip", "control"), 80.0, 0) if one.kind == "tie points")
    image = orient(one.block)["image_residuals"]
    ties = one.block.tie_points
    wrong = dict(zip(zip(ties.track.tolist(), ties.photo.tolist(), strict=True), one.block.wrong, strict=True))
    single = np.bincount(ties.track, one.block.wrong) <= 1
    right = [
        used for t, p, used in zip(image.track, image.photo, image.used, strict=True) if t >= 0 and single[t] and not wrong[t, p]
    ]
    assert np.mean(right) > 0.985
