"""One job: its inputs are read, its results written whole, and its end recorded, whatever the end is."""

import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from toy_stages import SIZE, Size, make_size

from orthomill.pipeline.engine.execute import JobFailed, JobOrder, execute
from orthomill.pipeline.engine.runner import ATTEMPTS, SequentialRunner
from orthomill.pipeline.records import record_files
from orthomill.pipeline.records.records import Fingerprint, Records
from orthomill.pipeline.storage import store
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Export, Job, Raster, Table, TextFile
from orthomill.schemas.raster import RasterSpec, Window

PRINT = Fingerprint(settings="s", code="c", inputs="i")
SPEC = RasterSpec(name="a/z", shape=(64, 64), dtype="float32", chunk=64)
SIDES = {"rows": 3, "cols": 4}
KEY = ("a", "size", 0, 0)


class Both(NamedTuple):
    """A raster and a table of one job."""

    z: np.ndarray
    size: Size
    more: Size | None = None


def both(z: np.ndarray) -> Both:
    return Both(z + 1, Size(rows=1, cols=2))


def measure(text: str) -> Size:
    return Size(rows=text.count("\n"), cols=len(text))


def refuse(rows: int, cols: int) -> Size:
    raise GeometryError("The rays do not intersect; add a photograph.")


def stumble(rows: int, cols: int) -> Size:
    return Size(rows=rows // 0, cols=cols)


def wrong(rows: int, cols: int) -> Size:
    return {"other": Size(rows=rows, cols=cols)}


def order(root: Path, job: Job | Export, run: str = "", wave: int = 1) -> JobOrder:
    return JobOrder(job, root, root / "run", PRINT, "not done yet", run, wave)


def size_job(function=make_size) -> Job:
    return Job(stage="a", item="size", function=function, reads={}, writes={"size": SIZE}, params=SIDES)


def test_a_table_is_written_and_recorded(tmp_path):
    assert execute(order(tmp_path, size_job())) == KEY
    assert Store(tmp_path / "run").table(SIZE) == Size(rows=3, cols=4)
    record = Records(tmp_path / "run").get(KEY)
    assert (record.status, record.reason, record.fingerprint, record.births) == ("done", "not done yet", PRINT, {})
    assert record.peak_bytes > 0 and record.seconds >= 0


def test_processor_time_is_recorded_apart_from_waiting(tmp_path):
    def wait_and_work(rows: int, cols: int) -> Size:
        time.sleep(0.2)
        end = time.process_time() + 0.1
        while time.process_time() < end:
            pass
        return Size(rows=rows, cols=cols)

    execute(order(tmp_path, size_job(wait_and_work)))
    record = Records(tmp_path / "run").get(KEY)
    assert 0.1 <= record.cpu_seconds < record.seconds and record.seconds >= 0.3


def test_several_results_go_where_their_names_say(tmp_path):
    store = Store(tmp_path / "run")
    store.create(SPEC)
    region = Raster("a/z", SPEC.full)
    execute(order(tmp_path, Job(stage="a", item="size", function=both, reads={"z": region}, writes={"z": region, "size": SIZE})))
    assert (store.read("a/z", SPEC.full) == 1).all() and store.table(SIZE).cols == 2
    assert Records(tmp_path / "run").get(KEY).births == {"a/z": store.birth("a/z")}


def test_several_regions_arrive_as_a_tuple(tmp_path):
    store = Store(tmp_path / "run")
    store.create(SPEC)
    seen = []

    def shapes(parts: tuple[np.ndarray, ...]) -> Size:
        seen.extend(part.shape for part in parts)
        return Size(rows=0, cols=0)

    regions = (Raster("a/z", Window(0, 0, 3, 4)), Raster("a/z", Window(5, 5, 6, 7)))
    execute(order(tmp_path, Job(stage="a", item="size", function=shapes, reads={"parts": regions}, writes={"size": SIZE})))
    assert seen == [(3, 4), (6, 7)]


@pytest.mark.parametrize("content", [b"a,b\n1,2\n", b"\xef\xbb\xbfa,b\n1,2\n"])
def test_a_text_arrives_without_a_byte_order_mark(tmp_path, content):
    (tmp_path / "points.csv").write_bytes(content)
    execute(
        order(
            tmp_path, Job(stage="a", item="size", function=measure, reads={"text": TextFile("points.csv")}, writes={"size": SIZE})
        )
    )
    assert Store(tmp_path / "run").table(SIZE) == Size(rows=2, cols=8)


def test_a_file_that_is_not_text_is_a_sentence(tmp_path):
    (tmp_path / "points.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(JobFailed) as caught:
        execute(
            order(
                tmp_path,
                Job(stage="a", item="size", function=measure, reads={"text": TextFile("points.csv")}, writes={"size": SIZE}),
            )
        )
    assert "holds NUL bytes or other data that are no text" in caught.value.sentence


@pytest.mark.parametrize(
    ("function", "sentence"),
    [
        (refuse, "The rays do not intersect; add a photograph."),
        (stumble, "unexpected ZeroDivisionError: "),
        (wrong, "must return ['size'] but returned ['other']"),
    ],
)
def test_a_failure_is_recorded_with_its_sentence_and_traceback(tmp_path, function, sentence):
    with pytest.raises(JobFailed) as caught:
        execute(order(tmp_path, size_job(function)))
    record = Records(tmp_path / "run").get(KEY)
    assert record.status == "failed" and "Traceback" in record.traceback
    assert sentence in record.error and caught.value.sentence == record.error and caught.value.key == KEY
    assert not Store(tmp_path / "run").has_table(SIZE)


def test_a_job_that_this_run_has_done_is_not_done_again(tmp_path):
    execute(order(tmp_path, size_job(), run="now"))
    Store(tmp_path / "run").write_table(SIZE, Size(rows=99, cols=99))
    execute(order(tmp_path, size_job(), run="now"))
    assert Store(tmp_path / "run").table(SIZE).rows == 99
    execute(order(tmp_path, size_job(), run="later"))
    assert Store(tmp_path / "run").table(SIZE).rows == 3


def other_size(item: str) -> Job:
    table = Table(f"a/{item}.json", Size)
    return Job(stage="a", item=item, function=make_size, reads={}, writes={"size": table}, params=SIDES)


def test_what_others_recorded_is_read_where_a_result_is_there_and_not_for_new_ones(tmp_path, monkeypatch):
    read: list[str] = []
    refresh = record_files.StageFiles.refresh
    monkeypatch.setattr(record_files.StageFiles, "refresh", lambda stage: (read.append(stage.folder), refresh(stage)))
    for item in ("first", "second", "third"):
        execute(order(tmp_path, other_size(item), run="now"))
    assert not read
    monkeypatch.setattr(record_files, "_PROCESS", "another")
    done = Records(tmp_path / "run", 1).get(("a", "third", 0, 0))
    Records(tmp_path / "run", 1).put(done.model_copy(update={"item": "fourth", "worker": "another"}))
    Store(tmp_path / "run").write_table(Table("a/fourth.json", Size), Size(rows=99, cols=99))
    execute(order(tmp_path, other_size("fourth"), run="now"))
    assert Store(tmp_path / "run").table(Table("a/fourth.json", Size)).rows == 99, "the other worker has done it"


def test_a_record_is_taken_back_before_results_are_touched_and_a_new_job_has_none(tmp_path):
    def lines(wave: int) -> list[bytes]:
        (log,) = (tmp_path / "run/jobs/a").glob(f"{wave:08d}-*.log")
        return [line.split(b"\t")[1] for line in log.read_bytes().splitlines()]

    execute(order(tmp_path, size_job(), run="now"))
    assert lines(1) == [b"done"]
    execute(replace(order(tmp_path, size_job(), run="later", wave=2), reason="settings changed"))
    assert lines(2) == [b"removed", b"done"]


def test_the_metadata_of_a_raster_are_read_once_in_a_run(tmp_path, monkeypatch):
    def ones(window: Window) -> np.ndarray:
        return np.ones(window.shape, np.float32)

    read, spec = [], RasterSpec(name="a/z", shape=(64, 128), dtype="float32", chunk=64)
    Store(tmp_path / "run").create(spec)
    found = store.stored_array
    monkeypatch.setattr(store, "stored_array", lambda depot, place: (read.append(place), found(depot, place))[1])
    for run in ("now", "later"):
        for col in (0, 1):
            window = Window(0, 64 * col, 64, 64)
            job = Job("a", "tile", ones, {}, {"ones": Raster(spec.name, window)}, {"window": window}, col=col)
            execute(order(tmp_path, job, run))
    assert read == ["rasters.zarr/a/z"] * 2


def test_a_job_that_fails_now_leaves_no_record_of_its_earlier_success(tmp_path):
    execute(order(tmp_path, size_job()))
    with pytest.raises(JobFailed):
        execute(order(tmp_path, size_job(refuse), wave=2))
    assert Records(tmp_path / "run").get(KEY).status == "failed"


def test_an_export_is_a_job_like_any_other(tmp_path):
    Store(tmp_path / "run").write_table(SIZE, Size(rows=1, cols=2))
    execute(order(tmp_path, Export("a", "file", "products/size.json", "json", tables=(SIZE,))))
    assert (tmp_path / "run" / "products" / "size.json").exists()
    assert Records(tmp_path / "run").get(("a", "file", 0, 0)).status == "done"


# --- the sequential runner ---------------------------------------------------------------------------------------------------


def ends(runner: SequentialRunner) -> dict:
    found = {}
    while runner.busy:
        ended = runner.next()
        found[ended.key] = ended
    return found


def test_jobs_after_a_failure_are_blocked_and_others_run(tmp_path):
    runner = SequentialRunner(2**30)
    names = ("first", "after", "last", "alone")
    jobs = {
        name: Job(stage="a", item=name, function=make_size, reads={}, writes={"size": Table(f"a/{name}.json", Size)}, params=SIDES)
        for name in names
    }
    jobs["first"] = Job(
        stage="a", item="first", function=refuse, reads={}, writes={"size": Table("a/first.json", Size)}, params=SIDES
    )
    for name, before in (("first", ()), ("after", ("first",)), ("last", ("after",)), ("alone", ())):
        runner.submit(order(tmp_path, jobs[name]), tuple(("a", other, 0, 0) for other in before), 0)
    status = {key[1]: ended.status for key, ended in ends(runner).items()}
    assert status == {"first": "failed", "after": "blocked", "last": "blocked", "alone": "done"}


class Attempts:
    """Fails a given number of times."""

    def __init__(self, failures: int) -> None:
        self.failures, self.calls = failures, 0

    def __call__(self) -> Size:
        self.calls += 1
        if self.calls <= self.failures:
            raise GeometryError("not yet.")
        return Size(rows=0, cols=0)


@pytest.mark.parametrize(("failures", "status"), [(ATTEMPTS - 1, "done"), (ATTEMPTS, "failed")])
def test_a_job_is_tried_again(tmp_path, failures, status):
    function = Attempts(failures)
    runner = SequentialRunner(2**30)
    runner.submit(order(tmp_path, Job(stage="a", item="size", function=function, reads={}, writes={"size": SIZE})), (), 0)
    assert ends(runner)[KEY].status == status and function.calls == ATTEMPTS


def test_a_closed_runner_has_nothing_to_do(tmp_path):
    runner = SequentialRunner(2**30)
    runner.submit(order(tmp_path, size_job()), (), 0)
    runner.close()
    assert not runner.busy
