"""A run whose products are above the project's bound: sheets on many workers, killed between them, and the bound changed."""

import shutil
from pathlib import Path
from typing import ClassVar, Literal

import pytest
import rasterio
from killed_runner import Killed, KilledRunner
from long_stage import JOINED_JOB, SHEET_JOBS, LongStage
from toy_stages import MEMORY, PROJECT

from orthomill.pipeline.cli.export_choice import chosen_exports
from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.pipeline.export.exports import export
from orthomill.pipeline.records.verification import verify
from orthomill.pipeline.storage.depots.kept_at import depot_of, keep_in
from orthomill.pipeline.storage.depots.kept_products import KeptProducts
from orthomill.pipeline.storage.depots.product_files import product_file
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Job, MapHeader, Table
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.stage_contract import Stage

EXTENT = Table("reader/extent.json", MapGrid)


def session_of(root: Path, above: float, **stage) -> Session:
    return Session(PROJECT.model_copy(update={"sheets_above": above}), (LongStage(**stage),), root, lambda source: ())


def run(root: Path, above: float = 0.001, runner=None, **stage) -> tuple[Session, str]:
    """A run, swept, and what it says of products that it replaced."""
    session = session_of(root, above, **stage)
    session.run(runner or SequentialRunner(MEMORY), Unwatched())
    assert not session.failures
    session.drop_parts()
    return session, session.drop_replaced()


def files(root: Path) -> dict[str, bytes]:
    folder = root / "runs/toy"
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in (folder / "products").rglob("*") if path.is_file()}


IN_SHEETS = {"products/z.vrt", "products/z_sheets/0-0.tif", "products/z_sheets/2-0.tif", "products/z_sheets/sheets.gpkg"}


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """A finished run in sheets, and its files."""
    root = tmp_path_factory.mktemp("once")
    session, said = run(root)
    assert said == "" and {*SHEET_JOBS, JOINED_JOB} <= session.done
    return root, files(root)


@pytest.fixture
def finished(once, tmp_path):
    shutil.copytree(once[0], tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_they_are_written_but_for_the_empty_one_and_nothing_is_done_again(finished, once):
    assert set(once[1]) == IN_SHEETS
    session = session_of(finished, 0.001)
    session.plan()
    assert not session.pending
    found = verify(finished / "runs/toy")
    assert not found.damaged


@pytest.mark.parametrize("tile", [1024, 3072])
def test_any_tiling_gives_the_same_files(tile, once, tmp_path):
    run(tmp_path, tile=tile)
    assert files(tmp_path) == once[1]


def test_two_workers_write_the_files_of_one(once, tmp_path):
    with local_client(2, MEMORY, 0) as client:
        runner = DaskRunner(client, MEMORY, "two processes", MEMORY)
        try:
            run(tmp_path, runner=runner)
        finally:
            runner.close()
    assert files(tmp_path) == once[1]


@pytest.mark.parametrize(
    ("last", "behind", "again"),
    [
        (SHEET_JOBS[0], False, {*SHEET_JOBS, JOINED_JOB}),
        (SHEET_JOBS[0], True, {*SHEET_JOBS[1:], JOINED_JOB}),
        (SHEET_JOBS[1], True, {SHEET_JOBS[2], JOINED_JOB}),
        (JOINED_JOB, False, {JOINED_JOB}),
        (JOINED_JOB, True, set()),
    ],
)
def test_a_run_killed_between_sheets_does_only_what_is_missing(last, behind, again, once, tmp_path):
    with pytest.raises(Killed):
        run(tmp_path, runner=KilledRunner(lambda key: key == last, behind))
    assert run(tmp_path)[0].done == again
    assert files(tmp_path) == once[1]


def test_a_lost_sheet_is_made_again_alone(finished, once):
    (finished / "runs/toy/products/z_sheets/2-0.tif").unlink()
    assert run(finished)[0].done == {SHEET_JOBS[2]}
    assert files(finished) == once[1]


def test_a_bound_that_changed_leaves_one_form_and_says_so_once(finished, once):
    said = run(finished, above=40.0)[1]
    assert said.endswith("by sheets_above, and the old files removed: products/z.tif in place of products/z.vrt.")
    whole = files(finished)
    assert set(whole) == {"products/z.tif"} and run(finished, above=40.0)[1] == ""
    with rasterio.open(finished / "runs/toy/products/z.tif") as file, rasterio.open(once[0] / "runs/toy/products/z.vrt") as joined:
        assert file.read().tobytes() == joined.read().tobytes()
    assert not verify(finished / "runs/toy").damaged
    session, said = run(finished)
    assert {*SHEET_JOBS, JOINED_JOB} >= session.done >= {
        SHEET_JOBS[0],
        SHEET_JOBS[2],
        JOINED_JOB,
    } and "products/z.vrt in place of products/z.tif" in said
    assert files(finished) == once[1] and run(finished)[1] == ""
    assert not verify(finished / "runs/toy").damaged


def test_a_run_killed_before_the_old_form_went_removes_it_the_next_time(finished, once):
    (finished / "runs/toy/products/z.tif").write_bytes(b"earlier")
    session, said = run(finished)
    assert not session.done and "z.vrt in place of products/z.tif" in said
    assert files(finished) == once[1]


def test_sheets_that_a_smaller_raster_has_no_more_go_without_a_word(finished):
    assert run(finished, rows=20000)[1] == ""
    assert set(files(finished)) == IN_SHEETS - {"products/z_sheets/2-0.tif"}
    assert not verify(finished / "runs/toy").damaged


def test_all_products_are_written_again_by_export(finished, once):
    session = session_of(finished, 0.001)
    chosen = chosen_exports(session, None, None)
    shutil.rmtree(finished / "runs/toy/products")
    left = [name for job in chosen for name in export(job, session.store, session.folder)]
    assert left == ["products/z_sheets/0-0.tif", "products/z_sheets/2-0.tif", "products/z.vrt"]
    assert files(finished) == once[1]


def test_a_file_in_parts_is_written_again_by_export(tmp_path):
    session, _ = run(tmp_path, above=40.0)
    before = files(tmp_path)
    (tmp_path / "runs/toy/products/z.tif").unlink()
    for job in chosen_exports(session, None, None):
        export(job, session.store, session.folder)
    assert files(tmp_path) == before


def test_an_object_store_holds_the_same_files_and_its_copies_keep_one_form(once, tmp_path):
    pytest.importorskip("obstore")
    folder = tmp_path / "runs/toy"
    keep_in(folder, "memory://sheets")
    run(tmp_path)
    depot = depot_of(folder)
    assert {name: depot.get(name) for name in depot.names("products")} == once[1]
    assert not run(tmp_path)[0].done and not verify(folder).damaged
    assert KeptProducts(folder).names == tuple(sorted(once[1]))
    KeptProducts(folder).raster("z")
    assert files(tmp_path) == once[1] and product_file(folder, "z") == folder / "products/z.vrt"
    assert "products/z.tif in place of products/z.vrt" in run(tmp_path, above=40.0)[1]
    assert list(depot.names("products")) == ["products/z.tif"]
    assert KeptProducts(folder).names == ("products/z.tif",)
    assert KeptProducts(folder).raster("z") == product_file(folder, "z") == folder / "products/z.tif"
    run(tmp_path)
    assert KeptProducts(folder).names == tuple(sorted(once[1]))
    KeptProducts(folder).raster("z")
    assert product_file(folder, "z") == folder / "products/z.vrt"


class ReaderStage(Stage):
    """Reads the sheets of another run."""

    title: ClassVar[str] = "Reader"
    kind: Literal["reader"] = "reader"

    def plan(self, view):
        reads = {"file": MapHeader("runs/before/products/z.vrt", "EPSG:2100")}
        yield Job("reader", "extent", extent_of, reads, {"extent": EXTENT})


def extent_of(file: MapGrid) -> MapGrid:
    return file


def test_sheets_are_no_input_of_a_run(tmp_path):
    session = Session(PROJECT, (ReaderStage(),), tmp_path, lambda source: ())
    with pytest.raises(WorkflowError, match=r"joins sheets.*orthomill export PROJECT --as geotiff"):
        session.plan()
