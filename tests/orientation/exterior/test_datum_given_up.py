"""A block that cannot be adjusted with what was surveyed is a free block with a report, and not a failure."""

from dataclasses import replace

import pytest
from orienting import orient, sentences
from simulated_block import two_strips

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.solve.minimise import NotConverged
from orthomill.tasks.orientation.exterior import adjusted_block


def test_observations_that_pull_are_named_and_left_out(monkeypatch):
    really = adjusted_block.adjust_tested

    def only_free(network, *rest):
        if not network.free:
            raise NotConverged("The bundle adjustment did not converge.")
        return really(network, *rest)

    monkeypatch.setattr(adjusted_block, "adjust_tested", only_free)
    block = two_strips(3, tracks=400)
    wrong = block.control.points[2]
    x, y, z = wrong.xyz
    point = wrong.model_copy(update={"xyz": (x, y + 90.0, z)})
    points = tuple(point if one is wrong else one for one in block.control.points)
    out = orient(replace(block, control=block.control.model_copy(update={"points": points})))
    assert len(out["block"].photos) == 6 and out["block"].datum.startswith("Free network")
    told = next(text for text in sentences(out["precision"]) if "pull against its tie points" in text)
    assert f"most of all {wrong.name}, " in told


def test_a_free_block_that_does_not_converge_still_fails(monkeypatch):
    def never(*_):
        raise NotConverged("The bundle adjustment did not converge.")

    monkeypatch.setattr(adjusted_block, "adjust_tested", never)
    with pytest.raises(GeometryError, match="did not converge"):
        orient(two_strips(3, tracks=400, gnss=None, control=0, check=0))
