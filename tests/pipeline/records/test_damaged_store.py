"""Files of a finished project are lost, cut and flipped: all are found, and a run makes the same project again, bit for bit."""

import os
import random
import shutil

import pytest
from toy_stages import TOTAL, SmoothStage, SourceStage, SumStage, run_in

from orthomill.pipeline.records.records import Records
from orthomill.pipeline.records.verification import verify
from orthomill.pipeline.storage.store import Store

STAGES = (SourceStage(rows=700, cols=700), SmoothStage(), SumStage())


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    root = tmp_path_factory.mktemp("finished")
    run_in(root, *STAGES)
    return root


@pytest.fixture
def project(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "copy")


def folder_of(root):
    return root / "runs" / "toy"


def content_of(root):
    """Rasters as their readers see them, and the bytes of tables and products."""
    store = Store(folder_of(root))
    rasters = {name: store.read(name, store.spec(name).full).tobytes() for name in store.names()}
    files = [path for part in ("tables", "products") for path in (folder_of(root) / part).rglob("*") if path.is_file()]
    return rasters | {path.relative_to(root).as_posix(): path.read_bytes() for path in files}


def damage(path, how, chance):
    before = path.stat()
    if how == "deleted":
        path.unlink()
        return
    content = bytearray(path.read_bytes())
    if how == "cut":
        del content[chance.randrange(len(content)) :]
    else:
        content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))  # as a failing disk does it, without a trace


@pytest.mark.parametrize("seed", range(8))
def test_whatever_is_lost_cut_or_flipped_is_found_and_made_again(finished, project, seed):
    chance = random.Random(seed)
    folder = folder_of(project)
    files = sorted(path for part in ("rasters.zarr", "tables", "jobs") for path in (folder / part).rglob("*") if path.is_file())
    hit = {path.relative_to(folder).as_posix(): chance.choice(("deleted", "cut", "flipped")) for path in chance.sample(files, 25)}
    for name, how in hit.items():
        damage(folder / name, how, chance)
    found = verify(folder)
    records = [name for name in hit if name.startswith("jobs/")]
    # A lost record leaves no trace but a job that is not done, and what a damaged one says of its files is not believed: these
    # files are made again whatever they are like.
    kept = {record.key for record in Records(folder).sort_out()[0]}
    lost = [record for record in Records(folder_of(finished)).sort_out()[0] if record.key not in kept]
    made_again = {path for record in lost for path in record.files}
    assert set(hit) - set(records) - made_again <= set(found.damaged) | set(found.mended)
    flipped = [name for name in records if hit[name] == "flipped"]
    assert all(name in found.damaged or any(record.stage in name for record in lost) for name in flipped)
    session = run_in(project, *STAGES)
    assert not session.failures
    assert content_of(project) == content_of(finished)
    assert verify(folder).damaged == {} and not run_in(project, *STAGES).done


def test_a_lost_chunk_is_noticed_without_asking(project):
    chunk = folder_of(project) / "rasters.zarr/source/numbers/c/2/3"
    chunk.unlink()
    session = run_in(project, *STAGES)
    assert session.done == {("source", "tile", 2, 3)}
    assert session.defects == {("source", "tile", 2, 3): "result is missing"}


@pytest.mark.parametrize(
    ("name", "writer"),
    [
        ("rasters.zarr/source/numbers/c/2/3", ("source", "tile", 2, 3)),
        ("rasters.zarr/smooth/numbers/c/1/1", ("smooth", "tile", 1, 1)),
    ],
)
def test_silent_damage_that_a_reader_meets_is_made_again_in_the_same_run(finished, project, name, writer):
    """Neither size nor time betray it: the reader's checksum does."""
    damage(folder_of(project) / name, "flipped", random.Random(1))
    session = run_in(project, *STAGES, forced=frozenset({"smooth", "sum"} if writer[0] == "source" else {"sum"}))
    assert session.defects == {writer: "result is damaged"} and not session.failures and not session.blocked
    assert content_of(project) == content_of(finished)
    assert not run_in(project, *STAGES).done


def test_a_chunk_that_is_all_fill_value_has_no_file_and_is_not_missed(tmp_path):
    stages = (SourceStage(factor=0.0), SmoothStage(), SumStage())
    first = run_in(tmp_path, *stages)
    assert first.store.table(TOTAL).total == 0 and not list((folder_of(tmp_path) / "rasters.zarr").rglob("c/*"))
    assert not run_in(tmp_path, *stages).done


def test_an_older_record_of_the_same_file_is_no_damage(tmp_path):
    """Another tiling leaves records of tiles that no longer exist; the rasters were made again since."""
    run_in(tmp_path, tile=128)
    run_in(tmp_path, tile=256)
    assert verify(folder_of(tmp_path)).damaged == {}
    run_in(tmp_path, SourceStage(factor=2.0), SmoothStage(), SumStage(), tile=256)
    assert verify(folder_of(tmp_path)).damaged == {}


def test_flipped_metadata_of_a_raster_are_not_believed(finished, project):
    path = folder_of(project) / "rasters.zarr/smooth/numbers/zarr.json"
    path.write_text(path.read_text().replace('"fill_value": 0.0', '"fill_value": 1.0'))
    assert verify(folder_of(project)).damaged.keys() == {"rasters.zarr/smooth/numbers/zarr.json"}
    session = run_in(project, *STAGES)
    assert set(session.reasons.values()) == {"result is missing"}
    assert content_of(project) == content_of(finished)
