"""The relative orientation of a pair of a run on the terminal: a table, JSON, and what cannot be answered."""

import json
from pathlib import Path

import pytest
from orienting import orient
from simulated_block import two_strips
from small_site import command, make_site

from orthomill.pipeline.cli.lookups.relative_lines import pair_forms, relative_lines
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.observations import TIE_POINTS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.tasks.lookups import classical_forms


@pytest.fixture(scope="module")
def oriented():
    block = two_strips(seed=4)
    return block, orient(block)["block"]


@pytest.fixture
def site(tmp_path, monkeypatch, oriented):
    """A project whose run holds a block."""
    monkeypatch.chdir(make_site(tmp_path))
    simulated, block = oriented
    store = Store(tmp_path / "runs" / "site")
    for table, value in ((BLOCK, block), (PHOTOS, simulated.photos), (TIE_POINTS, simulated.tie_points)):
        store.write_table(table, value)
    return block


def test_both_forms_and_both_sources_are_printed(site):
    lines = list(relative_lines(pair_forms(Path("runs/site"), *site.names[:2], classical_forms)))
    assert lines[0].startswith(f"{site.names[0]} and {site.names[1]}: ") and "sigma0 0.3" in lines[0]
    assert [line for line in lines if not line.startswith(" ")][1:] == ["dependent", "five rotations"]
    rows = [line.split() for line in lines if line.startswith("  ") and "unknown" not in line]
    assert len(rows) == 10 and all(abs(float(row[-1])) < 4 for row in rows), "differences in units of their standard errors"
    assert " ".join(" ".join(lines).split()) in " ".join(command("relative", "site", *site.names[:2]).split())


def test_json_holds_the_same_figures(site):
    found = json.loads(command("relative", "site", *site.names[:2], "--json"))
    assert len(found["unknowns"]) == 10 and found["kept"] <= found["matches"]
    assert {"form", "name", "unit", "of_points", "sigma_of_points", "of_block", "sigma_of_block"} == set(found["unknowns"][0])


def test_an_unknown_photograph_is_one_sentence(site):
    assert "ghost is not in the block; it holds" in command("relative", "site", site.names[0], "ghost", code=2)


def test_before_there_is_a_block_the_run_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path))
    assert "orthomill run site --until orientation" in command("relative", "site", "a", "b", code=2)
