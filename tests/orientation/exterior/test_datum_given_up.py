"""A block that cannot be adjusted with what was surveyed is a free block with a report, and not a failure."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from orienting import orient, sentences
from simulated_block import two_strips

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.solve.minimise import NotConverged
from orthomill.tasks.orientation.exterior import explained_adjustment
from orthomill.tasks.orientation.exterior.compared_blocks import explains_more


def test_observations_that_pull_are_named_and_left_out(monkeypatch):
    really = explained_adjustment.adjust_with_demanded

    def only_free(network, *rest):
        if not network.free:
            raise NotConverged("The bundle adjustment did not converge.")
        return really(network, *rest)

    monkeypatch.setattr(explained_adjustment, "adjust_with_demanded", only_free)
    block = two_strips(3, tracks=400)
    wrong = block.control.points[2]
    x, y, z = wrong.xyz
    point = wrong.model_copy(update={"xyz": (x, y + 90.0, z)})
    points = tuple(point if one is wrong else one for one in block.control.points)
    out = orient(replace(block, control=block.control.model_copy(update={"points": points})))
    assert len(out["block"].photos) == 6 and out["block"].datum.startswith("Free network")
    told = next(text for text in sentences(out["precision"]) if "pull against its tie points" in text)
    assert f"most of all {wrong.name}, " in told


def test_a_photograph_that_keeps_the_rest_from_converging_is_left_out(monkeypatch):
    really = explained_adjustment.adjust_with_demanded

    def not_with_the_third(network, *rest):
        if network.photos == 6:
            raise NotConverged("The bundle adjustment did not converge.", photo=2)
        return really(network, *rest)

    monkeypatch.setattr(explained_adjustment, "adjust_with_demanded", not_with_the_third)
    block = two_strips(3, tracks=400)
    out = orient(block)["block"]
    name = block.photos.names[2]
    assert [one.photo for one in out.unoriented] == [name] and len(out.photos) == 5
    assert out.unoriented[0].reason.startswith(f"{name} was set aside, because the block cannot be adjusted with it")
    assert out.datum.startswith("Control")


def explained(sigma0_px, residual, used):
    """As much of a block as is compared: its rays have one `residual`, those of them that are `used`."""
    result = SimpleNamespace(sigma0_px=sigma0_px, residual=np.full((len(used), 2), residual), used=used)
    return SimpleNamespace(problem=SimpleNamespace(names=("a", "b")), result=result)


def test_of_two_starts_the_one_with_the_smaller_residuals_is_kept():
    all_used, most_used = np.ones(100, bool), np.arange(100) < 95
    bent, right = explained(2.0, 1.6, all_used), explained(0.5, 0.4, most_used)
    assert explains_more(right, bent) and not explains_more(bent, right)
    # With equal residuals the one with more rays explains more.
    assert explains_more(explained(0.5, 0.4, all_used), right)


def test_a_free_block_that_does_not_converge_still_fails(monkeypatch):
    def never(*_):
        raise NotConverged("The bundle adjustment did not converge.")

    monkeypatch.setattr(explained_adjustment, "adjust_with_demanded", never)
    with pytest.raises(GeometryError, match="did not converge"):
        orient(two_strips(3, tracks=400, gnss=None, control=0, check=0))
