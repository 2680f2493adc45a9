"""The graph of jobs: dependencies follow from regions, and what cannot be run is refused with a sentence."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_stages import SIZE, TOTAL, Size, Total, add_up, make_size

from orthomill.pipeline.engine.graph import PROCESS_BYTES, Graph, GraphError, NoWriter, check_memory
from orthomill.schemas.errors import ResourceError, WorkflowError
from orthomill.schemas.job import Export, Job, PhotoPixels, Raster, Table, TextFile
from orthomill.schemas.raster import RasterSpec, Window, tiles_of

SPEC = RasterSpec(name="a/z", shape=(100, 150), dtype="float32", chunk=64)
SIDES = {"rows": 1, "cols": 1}


def write(window: Window) -> np.ndarray:
    return np.zeros(window.shape, np.float32)


def height_of(z: np.ndarray) -> Size:
    return Size(rows=z.shape[0], cols=z.shape[1])


def same(size: Size) -> Size:
    return size


def measure(text: str) -> Size:
    return Size(rows=len(text), cols=0)


def look(photo: np.ndarray) -> Size:
    return Size(rows=photo.shape[0], cols=photo.shape[1])


def tile_job(window: Window, row: int = 0, col: int = 0, name: str = "a/z", stage: str = "a") -> Job:
    return Job(
        stage=stage,
        item="tile",
        function=write,
        reads={},
        writes={"z": Raster(name, window)},
        params={"window": window},
        row=row,
        col=col,
    )


@pytest.fixture
def graph(tmp_path):
    return Graph(tmp_path, "runs/toy")


@pytest.fixture
def tiled(graph):
    """A graph in which every tile of the raster a/z has its writer."""
    graph.add_raster(SPEC)
    for tile in tiles_of(SPEC.shape, SPEC.chunk):
        graph.add(tile_job(tile.window, tile.row, tile.col))
    return graph


def sum_job(*windows: Window) -> Job:
    return Job(
        stage="b",
        item="total",
        function=add_up,
        reads={"parts": tuple(Raster("a/z", window) for window in windows)},
        writes={"total": TOTAL},
    )


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_reader_depends_on_exactly_the_tiles_that_it_touches(tmp_path_factory, data):
    graph = Graph(tmp_path_factory.getbasetemp(), "runs/toy")
    graph.add_raster(SPEC)
    tiles = {("a", "tile", tile.row, tile.col): tile.window for tile in tiles_of(SPEC.shape, SPEC.chunk)}
    for (_, _, row, col), window in tiles.items():
        graph.add(tile_job(window, row, col))
    top, left = data.draw(st.integers(0, 99)), data.draw(st.integers(0, 149))
    window = Window(top, left, data.draw(st.integers(1, 100 - top)), data.draw(st.integers(1, 150 - left)))
    touched = {key for key, tile in tiles.items() if _overlap(tile, window)}
    planned = graph.add(sum_job(window))
    assert set(planned.dependencies) == touched


def _overlap(one: Window, other: Window) -> bool:
    rows = one.row < other.row + other.height and other.row < one.row + one.height
    return rows and one.col < other.col + other.width and other.col < one.col + one.width


def test_two_regions_of_one_tile_are_one_dependency(tiled):
    assert tiled.add(sum_job(Window(0, 0, 10, 10), Window(20, 20, 10, 10))).dependencies == (("a", "tile", 0, 0),)


def test_a_reader_of_a_table_depends_on_its_writer(graph):
    graph.add(Job(stage="a", item="size", function=make_size, reads={}, writes={"size": SIZE}, params=SIDES))
    planned = graph.add(
        Job(stage="b", item="copy", function=same, reads={"size": SIZE}, writes={"size": Table("b/size.json", Size)})
    )
    assert planned.dependencies == (("a", "size", 0, 0),) and graph.writer_of_table(SIZE.path) == ("a", "size", 0, 0)


@pytest.mark.parametrize(
    ("function", "reads", "missing"),
    [(height_of, {"z": Raster("a/z", Window(0, 0, 1, 1))}, "the raster a/z"), (same, {"size": SIZE}, "the table source/size.json")],
)
def test_a_reader_of_what_nobody_writes_yet_has_to_wait(graph, function, reads, missing):
    with pytest.raises(NoWriter, match=missing):
        graph.add(Job(stage="b", item="copy", function=function, reads=reads, writes={"size": Table("b/size.json", Size)}))
    assert not graph.jobs


def test_a_raster_that_is_announced_but_not_planned_yet_has_to_wait(graph):
    graph.add_raster(SPEC)
    graph.add(tile_job(Window(0, 0, 64, 64)))
    with pytest.raises(NoWriter, match=r"the raster a/z at chunk \(0, 1\)"):
        graph.add(sum_job(Window(0, 0, 64, 65)))


def test_a_job_planned_again_is_the_same_job(graph):
    graph.add_raster(SPEC)
    assert graph.add(tile_job(Window(0, 0, 64, 64))) is not None
    assert graph.add(tile_job(Window(0, 0, 64, 64))) is None


@pytest.mark.parametrize(
    ("job", "sentence"),
    [
        (tile_job(Window(0, 64, 64, 64), 0, 0), "Two different jobs are called"),
        (tile_job(Window(0, 0, 64, 64), 5, 5), "has two writers"),
        (tile_job(Window(10, 0, 64, 64), 7, 7), "which cuts its chunks of"),
        (tile_job(Window(0, 0, 64, 64), 7, 7, name="a/other"), "was not announced"),
        (sum_job(Window(90, 0, 20, 10)), "which has the shape"),
        (sum_job(Window(0, 0, 0, 0)), "which has the shape"),
        (
            Job(stage="b", item="copy", function=same, reads={"z": Raster("a/z", Window(0, 0, 1, 1))}, writes={"size": SIZE}),
            "does not fit the function same",
        ),
    ],
)
def test_jobs_that_cannot_be_run_are_refused(tiled, job, sentence):
    with pytest.raises(GraphError, match=sentence):
        tiled.add(job)


def test_two_writers_of_a_table_are_refused(graph):
    graph.add(Job(stage="a", item="size", function=make_size, reads={}, writes={"size": SIZE}, params=SIDES))
    with pytest.raises(GraphError, match="has two writers"):
        graph.add(Job(stage="b", item="size", function=make_size, reads={}, writes={"size": SIZE}, params=SIDES))


def test_a_raster_announced_differently_is_refused(graph):
    graph.add_raster(SPEC)
    graph.add_raster(SPEC.model_copy())
    with pytest.raises(GraphError, match="planned twice and differently"):
        graph.add_raster(SPEC.model_copy(update={"chunk": 32}))


def test_a_raster_may_name_its_readers(graph):
    graph.add_raster(SPEC.model_copy(update={"readers": ("c",)}))
    for tile in tiles_of(SPEC.shape, SPEC.chunk):
        graph.add(tile_job(tile.window, tile.row, tile.col))
    with pytest.raises(GraphError, match="The stage b may not read a/z; only c may"):
        graph.add(sum_job(Window(0, 0, 1, 1)))


def test_a_file_of_the_user_counts_with_its_content(graph, tmp_path):
    job = Job(stage="a", item="size", function=measure, reads={"text": TextFile("points.csv")}, writes={"size": SIZE})
    (tmp_path / "points.csv").write_text("a")
    first = graph.add(job)
    (tmp_path / "points.csv").write_text("ab")
    second = Graph(tmp_path, "runs/toy").add(job)
    assert first.dependencies == () and first.fingerprint.inputs != second.fingerprint.inputs
    assert first.fingerprint.settings == second.fingerprint.settings


def test_a_file_of_the_user_that_is_missing_is_a_sentence(graph):
    with pytest.raises(WorkflowError, match=r"points\.csv cannot be read \(No such file or directory\)"):
        graph.add(Job(stage="a", item="size", function=measure, reads={"text": TextFile("points.csv")}, writes={"size": SIZE}))


def test_a_file_that_an_export_makes_depends_on_the_export(tiled):
    tiled.add(Export("a", "picture", "photographs/p.tif", "tiff", {"z": "a/z"}))
    assert tiled.exported_files("photographs") == ("runs/toy/photographs/p.tif",)
    assert tiled.exported_files("products") == ()
    job = Job(
        stage="b",
        item="look",
        function=look,
        reads={"photo": PhotoPixels("runs/toy/photographs/p.tif", Window(0, 0, 8, 8))},
        writes={"size": SIZE},
    )
    assert tiled.add(job).dependencies == (("a", "picture", 0, 0),)


def test_an_export_depends_on_all_tiles_of_its_rasters(tiled):
    planned = tiled.add(Export("b", "file", "products/z.tif", "cog", {"z": "a/z"}))
    assert len(planned.dependencies) == 2 * 3
    with pytest.raises(NoWriter, match="the raster a/none"):
        tiled.add(Export("b", "other", "products/n.tif", "cog", {"z": "a/none"}))
    with pytest.raises(GraphError, match="has two writers"):
        tiled.add(Export("b", "again", "products/z.tif", "cog", {"z": "a/z"}))


def test_the_fingerprint_follows_settings_and_what_is_read(tiled):
    one, same, other = (tiled.add(job) for job in (_total("x", 0), _total("y", 0), _total("z", 64)))
    assert one.fingerprint.inputs == same.fingerprint.inputs != other.fingerprint.inputs


def _total(item: str, col: int) -> Job:
    total = Table(f"b/{item}.json", Total)
    return Job(
        stage="b", item=item, function=add_up, reads={"parts": (Raster("a/z", Window(0, col, 64, 64)),)}, writes={"total": total}
    )


def test_memory_is_the_process_and_what_a_job_reads_and_writes(tiled):
    planned = tiled.add(sum_job(Window(0, 0, 100, 150)))
    assert planned.memory == PROCESS_BYTES + 4 * 100 * 150 and planned.output_bytes == 0
    tile = tiled.jobs["a", "tile", 0, 0]
    assert tile.output_bytes == 4 * 64 * 64 and tile.memory == PROCESS_BYTES + 4 * 64 * 64


def test_a_job_beyond_the_memory_of_a_worker_is_refused(tiled):
    planned = tiled.jobs["a", "tile", 0, 0]
    check_memory(planned, planned.memory)
    with pytest.raises(ResourceError, match=r"The job a/tile/0/0 needs 600 MiB.*'tile' in the workflow"):
        check_memory(planned, planned.memory - 1)
