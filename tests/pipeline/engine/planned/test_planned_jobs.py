"""What is kept of planned jobs in columns is what was planned."""

import numpy as np
import pytest
from toy_stages import PROJECT

from orthomill.pipeline.engine.graph import Graph
from orthomill.pipeline.engine.planned.chunk_writers import ChunkWriters, chunks_of
from orthomill.pipeline.engine.planned.file_writers import FileWriters
from orthomill.pipeline.engine.planned.job_states import JobState, JobStates, KeysIn, Reasons
from orthomill.pipeline.engine.planned.pickled_jobs import LARGEST, dumps, loads
from orthomill.pipeline.engine.planned.planned_jobs import PendingJobs
from orthomill.pipeline.records.packed_list import BLOCK
from orthomill.schemas.job import Job, Raster
from orthomill.schemas.raster import RasterSpec, Window, tiles_of

SPEC = RasterSpec(name="a/z", shape=(1000, 1300), dtype="float32", chunk=64)


def fill(window: Window) -> np.ndarray:
    return np.zeros(window.shape, np.float32)


def copy(z: np.ndarray, window: Window) -> np.ndarray:
    return z


def job(item: str, row: int, col: int, window: Window, **more) -> Job:
    given = {"function": fill, "reads": {}, "writes": {"z": Raster("a/z", window)}, "params": {"window": window}}
    return Job(stage="a", item=item, row=row, col=col, **(given | more))


@pytest.fixture
def planned(tmp_path):
    """The graph of a raster and of a copy of it, and what was returned for each job."""
    graph = Graph(tmp_path, f"runs/{PROJECT.project}")
    graph.add_raster(SPEC)
    graph.add_raster(SPEC.model_copy(update={"name": "a/copy"}))
    tiles = list(tiles_of(SPEC.shape, SPEC.chunk))
    jobs = [graph.add(job("z", tile.row, tile.col, tile.window)) for tile in tiles]
    for tile in tiles:
        reads = {"z": Raster("a/z", tile.window.grown(1).clipped(SPEC.shape))}
        writes = {"copy": Raster("a/copy", tile.window)}
        jobs.append(graph.add(job("copy", tile.row, tile.col, tile.window, function=copy, reads=reads, writes=writes)))
    return graph, jobs


def test_jobs_are_found_by_key_and_by_number_as_they_were_planned(planned):
    graph, jobs = planned
    assert len(graph.jobs) == len(jobs) > 2 * BLOCK and list(graph.jobs.values()) == jobs
    assert all(graph.jobs[one.key] == one for one in reversed(jobs))
    assert max(len(one.dependencies) for one in jobs) == 9 and ("a", "z", 99, 0) not in graph.jobs


def test_pending_jobs_are_handed_over_in_their_order(planned):
    graph, jobs = planned
    pending = PendingJobs(graph.jobs)
    for number in range(1, len(jobs), 2):
        pending.append(number)
    assert list(pending) == jobs[1::2] and pending.output_bytes == sum(one.output_bytes for one in jobs[1::2])
    largest = max(one.memory for one in jobs[1::2])
    assert pending.first_above(largest) is None
    assert pending.first_above(largest - 1) == next(one for one in jobs[1::2] if one.memory == largest)
    assert [pending.popleft() for _ in range(3)] == jobs[1:6:2] and list(pending) == jobs[7::2]
    pending.clear()
    assert not pending and pending.first_above(0) is None and pending.output_bytes == 0


def test_the_keys_in_a_state_are_a_set(planned):
    keys = planned[0].jobs.keys_by_number
    states = JobStates(keys)
    done, skipped = KeysIn(states, JobState.DONE), KeysIn(states, JobState.SKIPPED)
    assert not done and states.counts("a") == [len(keys), 0, 0, 0, 0] and sum(states.counts("b")) == 0
    done.add(keys[300])
    skipped.add(keys[2])
    assert done == {keys[300]} and done | skipped == {keys[2], keys[300]} and states.is_valid(2) and not states.is_valid(3)
    skipped.add(keys[300])
    assert not done and len(skipped) == 2 and states.counts("a")[JobState.SKIPPED] == 2
    skipped.discard(keys[2])
    skipped.discard(keys[3])
    states.clear(JobState.SKIPPED)
    assert not skipped and states.counts("a")[JobState.TO_DO] == len(keys)


def test_reasons_are_told_by_key(planned):
    keys = planned[0].jobs.keys_by_number
    reasons = Reasons(keys)
    reasons.update({keys[5]: "code changed", keys[1]: "not done yet", keys[7]: "code changed"})
    assert dict(reasons) == {keys[1]: "not done yet", keys[5]: "code changed", keys[7]: "code changed"}
    del reasons[keys[5]]
    assert reasons.get(keys[5], "unchanged") == reasons.get(keys[400], "unchanged") == "unchanged" and len(reasons) == 2


def test_every_chunk_has_one_writer():
    writers = ChunkWriters()
    writers.add_raster(SPEC)
    window = Window(60, 64, 70, 64)
    assert list(chunks_of(SPEC, window)) == [(0, 1), (1, 1), (2, 1)]
    assert writers.claim("a/z", (2, 1), 7) == 7 and writers.claim("a/z", (2, 1), 8) == 7
    assert [writers.writer("a/z", chunk) for chunk in chunks_of(SPEC, window)] == [None, None, 7]


def test_every_file_has_one_writer_even_if_its_name_is_no_text():
    writers, odd = FileWriters(), b"\xff.json".decode(errors="surrogateescape")
    assert writers.claim(odd, 3) == 3 and writers.claim("b.json", 0) == 0 and writers.claim(odd, 4) == 3
    assert list(writers) == [odd, "b.json"] and writers.writer("c.json") is None and writers.writer(odd) == 3


def test_small_arrays_are_copied_and_large_ones_are_not():
    small, large = np.arange(5), np.zeros(LARGEST, np.uint8)
    (back,) = loads(dumps([job("z", 0, 0, Window(0, 0, 1, 1), params={"rows": small})]))
    assert np.array_equal(back.params["rows"], small) and back.function is fill
    with pytest.raises(ValueError, match="array of"):
        dumps([job("z", 0, 0, Window(0, 0, 1, 1), params={"rows": np.append(large, 0)})])
