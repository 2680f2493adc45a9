"""Strips beside each other, photographs against all others: a block whose only errors are those of its rays keeps its promises."""

from itertools import combinations

import numpy as np
import pytest
from tiny_block import EAST, NORTH, block, photos, surface, tie_points

from orthomill.schemas.accuracy.point_tests import PointTests
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import GroundResiduals, JointCovariance
from orthomill.tasks.accuracy.promises.disjoint_photographs import LEFT_OUT, STRIPS, photograph_differences, strips_of
from orthomill.tasks.accuracy.promises.kept_promises import reliability_of

_CERTAIN = tuple(map(tuple, np.diag([1e-12] * 6)))
_APART = tuple(map(tuple, np.zeros((6, 6))))


def certain_block(sigma: float):
    """The tiny block with orientations without errors, and rays of `sigma` px."""
    poses = tuple(photo.model_copy(update={"covariance": _CERTAIN}) for photo in block().photos)
    joint = tuple(JointCovariance(first=a, second=b, covariance=_APART) for a, b in combinations(block().names, 2))
    return block().model_copy(update={"photos": poses, "joint": joint, "sigma0_px": sigma})


def ground() -> GroundPoints:
    random = np.random.default_rng(3)
    x, y = EAST + random.uniform(-250, 250, 400), NORTH + random.uniform(-200, 200, 400)
    none = np.zeros(400, np.float32)
    return GroundPoints(np.arange(400), x, y, surface(x, y), none, none, none, none.astype(np.int16), none)


def test_strips_are_told_by_the_way_in_which_photographs_follow_each_other():
    assert list(strips_of(block(), photos()).values()) == [0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize(("true", "promised", "holds"), [(0.3, 0.3, True), (0.9, 0.3, False)])
def test_rays_that_are_as_good_as_promised_keep_it_and_others_do_not(true, promised, holds):
    found = photograph_differences(certain_block(promised), tie_points(true), ground(), photos())
    for kind in (STRIPS, LEFT_OUT):
        own = found.kind == kind
        ratios = np.abs(found.difference[own]) / found.promised[own]
        assert own.sum() > 100 and (0.6 < (ratios <= 1).mean() < 0.76) == holds
        assert ((ratios <= 2).mean() > 0.92) == holds
    nothing = GroundResiduals()
    kinds = {one.kind: one for one in reliability_of(PointTests(points=(), area_km2=0.0), nothing, (), found).kinds}
    assert kinds["photographs, left out in turn"].items == 6 and len(kinds) == 2


def test_a_block_that_promises_nothing_has_nothing_to_keep():
    silent = block().model_copy(update={"photos": tuple(p.model_copy(update={"covariance": None}) for p in block().photos)})
    assert not len(photograph_differences(silent, tie_points(0.3), ground(), photos()))
