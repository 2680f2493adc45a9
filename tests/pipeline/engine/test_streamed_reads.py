"""Streamed reads: what a job reads one region at a time is what it would have read at once, in memory that does not grow."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_stages import MEMORY, SIZE, TOTAL, Size, SmoothStage, SourceStage, SumStage, Total, add_up, run_in

from orthomill.pipeline.engine import execute as execute_
from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.engine.execute import JobFailed, JobOrder, execute
from orthomill.pipeline.engine.graph import PROCESS_BYTES, Graph, GraphError, NoWriter
from orthomill.pipeline.engine.job_signature import misfit
from orthomill.pipeline.records.records import Fingerprint, Records
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.job import Job, MapFile, PhotoPixels, Raster, Reading, Stream, TextFile
from orthomill.schemas.raster import MapGrid, RasterSpec, Window
from orthomill.schemas.stage_contract import Stage

SPEC = RasterSpec(name="a/z", shape=(40, 64), dtype="float32", chunk=64)
OUT = RasterSpec(name="b/z", shape=(40, 64), dtype="float32", chunk=64)
VALUES = np.random.default_rng(4).normal(size=SPEC.shape).astype(np.float32)


def run(root: Path, function, reads: dict[str, Reading], writes=None) -> None:
    """Execute one job in the folder of a run that holds the raster a/z."""
    store = Store(root / "run")
    if not store.has(SPEC.name):
        store.create(SPEC)
        store.write(SPEC.name, SPEC.full, VALUES)
        store.create(OUT)
    job = Job(stage="b", item="job", function=function, reads=reads, writes=writes or {"total": TOTAL})
    assert misfit(job) is None
    execute(JobOrder(job, root, root / "run", Fingerprint(settings="s", code="c", inputs="i"), "not done yet"))


def total(root: Path) -> float:
    return Store(root / "run").table(TOTAL).total


def accumulate(parts: Iterable[np.ndarray]) -> np.ndarray:
    """A result that depends on every value and on the order."""
    out = np.zeros(OUT.shape, np.float32)
    for number, part in enumerate(parts):
        rows, cols = part.shape
        out[:rows, :cols] = out[:rows, :cols] * np.float32(0.7) + part * np.float32(number + 1)
    return out


def at_once(parts: tuple[np.ndarray, ...]) -> np.ndarray:
    return accumulate(parts)


def one_by_one(parts: Iterator[np.ndarray]) -> np.ndarray:
    return accumulate(parts)


windows = st.builds(Window, st.integers(0, 19), st.integers(0, 31), st.integers(1, 20), st.integers(1, 32))


@settings(max_examples=15, deadline=None)
@given(chosen=st.lists(windows, max_size=6))
def test_a_stream_gives_what_a_tuple_gives_bit_for_bit(tmp_path_factory, chosen):
    root = tmp_path_factory.mktemp("run")
    regions = tuple(Raster(SPEC.name, window) for window in chosen)
    made = []
    for function, reading in ((at_once, regions), (one_by_one, Stream(regions))):
        run(root, function, {"parts": reading}, {"z": Raster(OUT.name, OUT.full)})
        made.append(Store(root / "run").read(OUT.name, OUT.full))
    assert np.array_equal(made[0], made[1])


def test_a_region_is_read_only_when_it_is_asked_for(tmp_path, monkeypatch):
    events = []
    read = Store.read

    def noted(self, name, window):
        events.append(f"read {window.row}")
        return read(self, name, window)

    def work(parts: Iterator[np.ndarray]) -> Total:
        for number, _ in enumerate(parts):
            events.append(f"use {number}")
            if number == 1:
                break
        return Total(total=number)

    monkeypatch.setattr(Store, "read", noted)
    run(tmp_path, work, {"parts": Stream(tuple(Raster(SPEC.name, Window(row, 0, 1, 4)) for row in range(5)))})
    assert events == ["read 0", "use 0", "read 1", "use 1"] and total(tmp_path) == 1


def test_a_stream_runs_once(tmp_path):
    def twice(parts: Iterator[np.ndarray]) -> Total:
        return Total(total=10 * len(list(parts)) + len(list(parts)))

    run(tmp_path, twice, {"parts": Stream((Raster(SPEC.name, SPEC.full),) * 3)})
    assert total(tmp_path) == 30


def test_streams_of_one_job_advance_independently(tmp_path):
    def paired(rows: Iterator[np.ndarray], cols: Iterator[np.ndarray], z: np.ndarray) -> Total:
        return Total(total=sum(float(row[0, 0] == z[0, k]) for k, (row, _) in enumerate(zip(rows, cols, strict=True))))

    rows = Stream(tuple(Raster(SPEC.name, Window(0, col, 1, 1)) for col in range(4)))
    run(tmp_path, paired, {"rows": rows, "cols": rows, "z": Raster(SPEC.name, SPEC.full)})
    assert total(tmp_path) == 4


def test_tables_and_texts_may_be_streamed(tmp_path):
    def lengths(texts: Iterator[str], sizes: Iterator[Size | Total]) -> Total:
        return Total(total=sum(map(len, texts)) + sum(size.rows for size in sizes if isinstance(size, Size)))

    (tmp_path / "a.txt").write_text("abc")
    Store(tmp_path / "run").write_table(SIZE, Size(rows=20, cols=0))
    Store(tmp_path / "run").write_table(TOTAL, Total(total=0))
    run(tmp_path, lengths, {"texts": Stream((TextFile("a.txt"),)), "sizes": Stream((SIZE, TOTAL))})
    assert total(tmp_path) == 23


def test_groups_are_read_together_when_they_are_asked_for(tmp_path, monkeypatch):
    events, together = [], execute_.side_by_side

    def noted(depot, read, regions):
        events.append([region.window.row for region in regions])
        return together(depot, read, regions)

    def work(groups: Iterator[tuple[np.ndarray, ...]]) -> Total:
        events.append("begun")
        assert [len(next(groups)), float(next(groups)[1][0, 0]) == VALUES[3, 0]] == [1, True]
        return Total(total=1)

    monkeypatch.setattr(execute_, "side_by_side", noted)
    run(
        tmp_path,
        work,
        {"groups": Stream(tuple(tuple(Raster(SPEC.name, Window(r, 0, 1, 4)) for r in g) for g in ((1,), (2, 3), (4,))))},
    )
    assert events == ["begun", [1], [2, 3]]


@pytest.mark.parametrize("stream", [False, True])
def test_what_cannot_be_read_ends_the_job_with_the_same_sentence(tmp_path, stream):
    def joined(texts: Iterator[str]) -> Total:
        return Total(total=sum(map(len, texts)))

    def joined_at_once(texts: tuple[str, ...]) -> Total:
        return Total(total=sum(map(len, texts)))

    (tmp_path / "good.txt").write_text("abc")
    (tmp_path / "bad.txt").write_bytes(b"\xff\xfe\x00")
    files = (TextFile("good.txt"), TextFile("bad.txt"))
    with pytest.raises(JobFailed) as caught:
        run(tmp_path, joined if stream else joined_at_once, {"texts": Stream(files) if stream else files})
    assert caught.value.sentence.startswith(f"{tmp_path / 'bad.txt'} holds NUL bytes or other data that are no text;")
    record = Records(tmp_path / "run").get(("b", "job", 0, 0))
    assert record.status == "failed" and record.error == caught.value.sentence and not Store(tmp_path / "run").has_table(TOTAL)


# --- the graph ---------------------------------------------------------------------------------------------------------------


def write(window: Window) -> np.ndarray:
    return np.zeros(window.shape, np.float32)


def add_streamed(parts: Iterator[np.ndarray]) -> Total:
    return Total(total=float(sum(part.astype(np.float64).sum() for part in parts)))


def planned(root: Path, reading: Reading, count: int = 0, streamed=add_streamed):
    """The planned job that reads `reading` in a graph with `count` rasters a/0, a/1, ... and their writers."""
    graph = Graph(root, "runs/toy")
    for number in range(count):
        spec = RasterSpec(name=f"a/{number}", shape=(64, 64), dtype="float32", chunk=64)
        graph.add_raster(spec)
        graph.add(
            Job(
                stage="a",
                item=str(number),
                function=write,
                reads={},
                writes={"z": Raster(spec.name, spec.full)},
                params={"window": spec.full},
            )
        )
    function = streamed if isinstance(reading, Stream) else add_up
    return graph.add(Job(stage="b", item="total", function=function, reads={"parts": reading}, writes={"total": TOTAL}))


def regions(count: int) -> tuple[Raster, ...]:
    return tuple(Raster(f"a/{number}", Window(0, 0, 64, 64)) for number in range(count))


def test_planned_memory_is_flat_from_ten_to_a_hundred_regions(tmp_path):
    ten, hundred = (planned(tmp_path, Stream(regions(count)), count).memory for count in (10, 100))
    assert ten == hundred == PROCESS_BYTES + 2 * 4 * 64 * 64
    assert planned(tmp_path, regions(100), 100).memory == PROCESS_BYTES + 100 * 4 * 64 * 64


@settings(max_examples=30, deadline=None)
@given(sides=st.lists(st.integers(1, 64), max_size=6))
def test_planned_memory_is_that_of_the_two_largest_regions(tmp_path_factory, sides):
    parts = tuple(Raster(f"a/{number}", Window(0, 0, side, 64)) for number, side in enumerate(sides))
    memory = planned(tmp_path_factory.getbasetemp(), Stream(parts), len(parts)).memory
    assert memory == PROCESS_BYTES + 4 * 64 * sum(sorted(sides, reverse=True)[:2])


def add_groups(parts: Iterator[tuple[np.ndarray, ...]]) -> Total:
    return Total(total=float(sum(part.astype(np.float64).sum() for group in parts for part in group)))


def test_planned_memory_is_that_of_the_largest_group(tmp_path):
    groups = Stream((regions(2), regions(5), regions(3)))
    job = planned(tmp_path, groups, 5, add_groups)
    assert groups.in_groups and job.memory == PROCESS_BYTES + 5 * 4 * 64 * 64
    assert job.dependencies == planned(tmp_path, regions(5), 5).dependencies
    assert "a stream of a tuple of ndarray" in str(misfit(replace(job.job, function=add_streamed)))


def test_files_of_a_stream_count_with_their_size(tmp_path):
    def look(pixels: Iterator[np.ndarray], map_: Iterator[np.ndarray]) -> Size:
        raise NotImplementedError

    (tmp_path / "a").write_bytes(b"")
    grid = MapGrid(west=0, north=0, cell=1, rows=8, cols=8)
    pixels = (PhotoPixels("a", Window(0, 0, 10, 10)),) * 5
    maps = (MapFile("a", "EPSG:2100", grid, Window(0, 0, 8, 8), bands=3),) * 5
    job = Job(stage="b", item="look", function=look, reads={"pixels": Stream(pixels), "map_": Stream(maps)}, writes={"size": SIZE})
    assert Graph(tmp_path, "runs/toy").add(job).memory == PROCESS_BYTES + 2 * 3 * 100 + 2 * 3 * 4 * 64


def test_a_stream_depends_on_the_writers_of_all_its_regions(tmp_path):
    streamed, eager = planned(tmp_path, Stream(regions(4)), 4), planned(tmp_path, regions(4), 4)
    assert streamed.dependencies == eager.dependencies == tuple(("a", str(number), 0, 0) for number in range(4))
    assert streamed.fingerprint.inputs == eager.fingerprint.inputs != planned(tmp_path, Stream(regions(3)), 4).fingerprint.inputs


def test_a_stream_is_checked_like_any_other_read(tmp_path):
    with pytest.raises(NoWriter, match="the raster a/1"):
        planned(tmp_path, Stream(regions(2)), 1)
    with pytest.raises(GraphError, match="which has the shape"):
        planned(tmp_path, Stream((*regions(1), Raster("a/0", Window(60, 0, 10, 10)))), 1)


def test_a_stream_fits_an_iterator_of_what_its_regions_hold():
    def cells(z: Iterator[np.ndarray], sizes: Iterable[Size]) -> Total:
        raise NotImplementedError

    def listed(z: Sequence[np.ndarray], sizes: tuple[Size, ...]) -> Total:
        raise NotImplementedError

    z, sizes = Stream(regions(3)), Stream((SIZE,))

    def wrong(function, **reads) -> str:
        return str(misfit(Job(stage="b", item="total", function=function, reads=reads, writes={"total": TOTAL})))

    assert wrong(cells, z=z, sizes=sizes) == wrong(cells, z=Stream(()), sizes=Stream(())) == "None"
    assert "'z' is read as a stream of Size, but the parameter is collections.abc.Iterator[numpy.ndarray]" in wrong(
        cells, z=sizes, sizes=sizes
    )
    assert "'sizes' is read as a stream of Size and Total" in wrong(cells, z=z, sizes=Stream((SIZE, TOTAL)))
    assert "'z' is read as a tuple of ndarray" in wrong(cells, z=regions(2), sizes=sizes)
    assert "'z' is read as a stream of ndarray, but the parameter is" in wrong(listed, z=z, sizes=(SIZE,))
    assert "'sizes' is read as a stream of Size" in wrong(listed, z=regions(2), sizes=sizes)


# --- whole runs --------------------------------------------------------------------------------------------------------------


class StreamedSum(Stage):
    """Adds up tile by tile."""

    title: ClassVar[str] = "adding up one by one"
    kind: Literal["sum"] = "sum"

    def plan(self, view):
        yield from (_streamed(job) for job in SumStage().plan(view))


def _streamed(job: Job) -> Job:
    return Job(
        stage=job.stage, item=job.item, function=add_streamed, reads={"parts": Stream(job.reads["parts"])}, writes=job.writes
    )


@pytest.mark.slow
def test_both_runners_stream_with_the_same_result(tmp_path):
    run_in(tmp_path / "eager")
    stages = (SourceStage(), SmoothStage(), StreamedSum())
    session = run_in(tmp_path / "one", *stages)
    again = run_in(tmp_path / "one", *stages)
    with local_client(1, MEMORY, 0) as client:
        run_in(tmp_path / "dask", *stages, runner=DaskRunner(client, MEMORY, "a test"))
    sums = {name: Store(tmp_path / name / "runs" / "toy").table(TOTAL).total for name in ("eager", "one", "dask")}
    assert len(set(sums.values())) == 1 and ("sum", "total", 0, 0) in session.done and not again.done
