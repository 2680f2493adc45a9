"""Parts of large products go when the products are there, and whoever kills a run meanwhile loses nothing by it."""

import os
from pathlib import Path

import pytest
from killed_runner import Killed, KilledRunner
from surface_stage import SurfaceStage
from toy_stages import run_in, session_in

from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.records.verification import verify

PARTS = [("surface", "file-parts", 0, 0), ("surface", "file-parts", 1, 0)]
WHOLE = ("surface", "file", 0, 0)


@pytest.fixture
def finished(tmp_path):
    run_in(tmp_path, SurfaceStage())
    return tmp_path


def product(root: Path) -> Path:
    return root / "runs/toy/products/z.tif"


def parts(root: Path) -> list[str]:
    return sorted(path.name for path in (root / "runs/toy/parts").rglob("*") if path.is_file())


def run_again(root: Path) -> Session:
    """A run of the whole command's course: planned, run, swept."""
    session = run_in(root, SurfaceStage())
    session.drop_parts()
    assert not session.failures and not parts(root)
    return session


def test_they_go_and_are_not_missed(finished):
    assert product(finished).exists() and not parts(finished)
    session = session_in(finished, SurfaceStage())
    session.plan()
    assert not session.pending
    found = verify(finished / "runs/toy")
    assert not found.damaged and found.files == 5 + 1 + 1, "chunks, product, table"


def test_a_lost_product_is_made_of_new_parts(finished):
    before = product(finished).read_bytes()
    product(finished).unlink()
    assert run_again(finished).done == {*PARTS, WHOLE}
    assert product(finished).read_bytes() == before


def test_a_product_that_its_reader_finds_damaged_is_made_of_new_parts(finished):
    before, state = product(finished).read_bytes(), product(finished).stat()
    product(finished).write_bytes(bytes(1000) + before[1000:])
    os.utime(product(finished), ns=(state.st_atime_ns, state.st_mtime_ns))
    (finished / "runs/toy/tables/surface/extent.json").unlink()
    assert run_again(finished).done == {*PARTS, WHOLE, ("surface", "extent", 0, 0)}
    assert product(finished).read_bytes() == before


@pytest.mark.parametrize(
    ("last", "behind", "left", "again"),
    [
        (PARTS[0], False, 0, {*PARTS, WHOLE}),
        (PARTS[0], True, 1, {PARTS[1], WHOLE}),
        (WHOLE, False, 2, {WHOLE}),
        (WHOLE, True, 2, set()),
    ],
)
def test_a_run_killed_anywhere_does_only_what_is_missing(tmp_path, last, behind, left, again):
    with pytest.raises(Killed):
        run_in(tmp_path, SurfaceStage(), runner=KilledRunner(lambda key: key == last, behind))
    assert len(parts(tmp_path)) == left
    assert run_again(tmp_path).done - {("surface", "extent", 0, 0)} == again
    run_in(tmp_path / "whole", SurfaceStage())
    assert product(tmp_path).read_bytes() == product(tmp_path / "whole").read_bytes()


def test_a_run_killed_while_they_go_needs_them_no_more(tmp_path, monkeypatch):
    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr(Session, "_drop_parts", one_less)
        run_in(tmp_path, SurfaceStage())
    assert len(parts(tmp_path)) == 1
    assert run_again(tmp_path).done == {("surface", "extent", 0, 0)}


def one_less(session: Session, number: int) -> None:
    """Killed when one of them has gone."""
    if session.graph.jobs.keys_by_number[number] == WHOLE:
        (session.folder / "parts/products/z.tif/0-0.tif").unlink()
        raise Killed
