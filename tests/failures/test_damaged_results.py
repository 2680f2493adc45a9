"""Results that are damaged on the disk: `verify` names them, and the next run makes them again."""

import re
import shutil

import pytest
from small_site import command, copy_of_finished_site, counts, finished_site, results_of

pytestmark = pytest.mark.slow


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A finished project; the current folder is its root."""
    monkeypatch.chdir(copy_of_finished_site(tmp_path / "site"))
    return tmp_path / "site"


def test_damage_is_named_counted_and_mended(site):
    run = site / "runs" / "site"
    chunks = sorted(path for path in (run / "rasters.zarr/photos").rglob("c/*/*/*"))[:12]
    for path in chunks:
        path.write_bytes(path.read_bytes()[:-1] + b"?")
    (run / "tables/orientation/block.json").unlink()
    said = command("verify", "site", code=1)
    assert f"{chunks[0].relative_to(run).as_posix()} is damaged" in said and "... and 3 more" in said
    assert "13 of " in said and "are lost or damaged; compute them again with: orthomill run site" in said
    said = command("run", "site", "--sequential")
    jobs = int(re.search(r"Found lost or damaged on the disk and computed again, (\d+) in all: photos/", said)[1])
    assert 13 > jobs > 4, f"a job writes several chunks: {said}"
    assert counts(said)[0] >= jobs and counts(said)[2] == 0
    assert results_of(site) == results_of(finished_site()[0])
    assert "are whole" in command("verify", "site")


def test_a_project_without_results_has_none_to_verify(site):
    shutil.rmtree(site / "runs")
    assert "site has no results yet" in command("verify", "site", code=2)
    assert not (site / "runs").exists()
