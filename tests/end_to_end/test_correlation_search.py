"""The published search for near-vertical pairs, chosen in a workflow: real photographs from their files to the block."""

import json

import pytest
from small_site import command_in, finished_site, make_site, write_workflow

SEARCH = {"kind": "correlation", "points": {"min_strength": 100.0}, "correlation": {"search": 151, "min_correlation": 0.7}}


def block_of(root) -> dict:
    return json.loads((root / "runs" / "site" / "tables" / "orientation" / "block.json").read_text())


def sides(block) -> list[float]:
    """The distances between the three projection centres, in units of the longest."""
    centres = [photo["centre"] for photo in block["photos"]]
    found = [sum((a - b) ** 2 for a, b in zip(one, other, strict=True)) ** 0.5 for one in centres for other in centres]
    return [one / max(found) for one in found]


@pytest.mark.slow
def test_photographs_are_oriented_by_correlation_as_by_features(tmp_path):
    root = make_site(tmp_path / "site")
    write_workflow(root, stages=["photos", "calibration", {"kind": "tie_points", "search": SEARCH}, "orientation"])
    command_in(root, "run", "site", "--sequential")
    found, expected = block_of(root), block_of(finished_site()[0])
    assert len(found["photos"]) == 3 and found["sigma0_px"] < 0.5
    assert sides(found) == pytest.approx(sides(expected), abs=0.02)
