"""The store refuses what would lose data, and gives back what it was given."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.records.records import Fingerprint, Record, reason_to_run
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.pipeline.storage.store import Store, aligned
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import StoreError
from orthomill.schemas.observations import TIE_POINTS, TiePoints
from orthomill.schemas.raster import MapGrid, RasterSpec, Window, map_raster, tiles_of


def spec_of(name="a/b", shape=(100, 90), chunk=32, dtype="float32", nodata=float("nan")) -> RasterSpec:
    return RasterSpec(name=name, shape=shape, dtype=dtype, chunk=chunk, nodata=nodata)


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path)


def test_a_new_raster_is_empty_and_remembers_its_specification(store):
    grid = MapGrid(west=400000.0, north=4360000.0, cell=0.5, rows=70, cols=50)
    spec = map_raster("densification/height", grid, "float32", "EPSG:2100", 32, nodata=float("nan"), unit="m")
    store.create(spec)
    assert np.isnan(store.read(spec.name, spec.full)).all()
    kept = Store(store.depot.path).spec(spec.name)
    assert Store(store.depot.path).create(spec) == store.birth(spec.name), "the same raster must survive a second run"
    assert kept.transform == grid.transform and kept.unit == "m" and store.names() == (spec.name,)


def test_writing_whole_chunks_comes_back(store):
    store.create(spec_of())
    values = np.arange(100 * 90, dtype=np.float32).reshape(100, 90)
    for tile in tiles_of(values.shape, 64):
        store.write("a/b", tile.window, values[tile.window.slices])
    assert np.array_equal(store.read("a/b", Window(10, 20, 50, 60)), values[10:60, 20:80])


CUTTING = [Window(1, 0, 31, 32), Window(0, 0, 32, 33), Window(96, 64, 3, 26), Window(0, 0, 128, 90), Window(0, 0, 0, 0)]


@pytest.mark.parametrize("window", CUTTING)
def test_a_write_that_cuts_a_chunk_is_refused(store, window):
    store.create(spec_of())
    with pytest.raises(StoreError, match="whole chunks"):
        store.write("a/b", window, np.zeros(window.shape, np.float32))


def test_wrong_shapes_and_kinds_are_refused(store):
    store.create(spec_of(dtype="uint8", nodata=0))
    with pytest.raises(StoreError, match=r"takes \(32, 32\)"):
        store.write("a/b", Window(0, 0, 32, 32), np.zeros((32, 31), np.uint8))
    with pytest.raises(StoreError, match="holds uint8"):
        store.write("a/b", Window(0, 0, 32, 32), np.zeros((32, 32), np.float32))


def test_reading_outside_or_what_is_not_there_is_refused(store):
    store.create(spec_of())
    with pytest.raises(StoreError, match="extends beyond the raster"):
        store.read("a/b", Window(90, 0, 20, 10))
    with pytest.raises(StoreError, match="run the stage 'texture' first"):
        store.read("texture/ortho", Window(0, 0, 1, 1))
    with pytest.raises(StoreError, match="a is no raster but holds several, such as a/b"):
        store.spec("a")


def test_another_specification_makes_another_raster(store):
    first = store.create(spec_of())
    assert store.create(spec_of()) == first
    store.write("a/b", Window(0, 0, 32, 32), np.ones((32, 32), np.float32))
    assert store.create(spec_of(chunk=16)) != first
    assert np.isnan(store.read("a/b", Window(0, 0, 4, 4))).all()


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 400), st.integers(1, 400), st.sampled_from([16, 33, 64, 128]))
def test_tiles_cover_a_raster_once_with_whole_chunks(rows, cols, size):
    seen = np.zeros((rows, cols), int)
    spec = spec_of(shape=(rows, cols), chunk=size)
    for tile in tiles_of((rows, cols), size):
        seen[tile.window.slices] += 1
        assert aligned(tile.window, spec.shape, spec.chunks)
    assert (seen == 1).all()


def test_what_a_killed_run_was_writing_is_removed(store):
    store.create(spec_of())
    store.write("a/b", Window(0, 0, 32, 32), np.ones((32, 32), np.float32))
    write_whole(store.depot.path / "tables" / "a.json", b"{}")
    before = sorted(store.depot.path.rglob("*"))
    for place in ("rasters.zarr/a/zarr.0f.partial", "rasters.zarr/a/b/c/1/0.1e.partial", "tables/.x1.part"):
        (store.depot.path / place).parent.mkdir(parents=True, exist_ok=True)
        (store.depot.path / place).write_bytes(b"half")
    store.sweep()
    assert [path for path in sorted(store.depot.path.rglob("*")) if path.is_file()] == [path for path in before if path.is_file()]
    assert (store.read("a/b", Window(0, 0, 32, 32)) == 1).all()


def test_long_tables_keep_their_columns(store):
    points = TiePoints(
        track=np.array([0, 0, 1], np.int32),
        photo=np.array([0, 1, 1], np.int32),
        col=np.array([1.5, 2.5, 3.25]),
        row=np.array([0.0, 1.0, 2.0]),
        sigma=np.array([0.1, 0.2, 0.3], np.float32),
    )
    store.write_table(TIE_POINTS, points)
    back = store.table(TIE_POINTS)
    assert back.col.dtype == np.float64 and back.sigma.dtype == np.float32
    assert np.array_equal(back.col, points.col) and len(back.take(back.track == 0)) == 2


def test_a_damaged_table_is_named(store):
    path = store.depot.path / store.table_path(TIE_POINTS)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"not parquet")
    with pytest.raises(StoreError, match="damaged"):
        store.table(TIE_POINTS)


def test_columns_of_different_length_cannot_be_built():
    with pytest.raises(ValueError, match="differ in length"):
        TiePoints(track=np.zeros(2), photo=np.zeros(1), col=np.zeros(2), row=np.zeros(2), sigma=np.zeros(2))


def record_of(**more) -> Record:
    fingerprint = Fingerprint(settings="a", code="b", inputs="c")
    return Record(stage="s", item="i/j", row=0, col=1, status="done", fingerprint=fingerprint, reason="", **more)


@pytest.mark.parametrize(
    ("fingerprint", "births", "defect", "reason"),
    [
        (("a", "b", "c"), {}, None, None),
        (("x", "b", "c"), {}, None, "settings changed"),
        (("a", "x", "c"), {}, None, "code changed"),
        (("a", "b", "x"), {}, None, "inputs changed"),
        (("a", "b", "c"), {"r": "1"}, None, "result is missing"),
        (("a", "b", "c"), {}, "missing", "result is missing"),
    ],
)
def test_the_reason_to_run_is_data(fingerprint, births, defect, reason):
    settings_, code, inputs = fingerprint
    assert reason_to_run(record_of(), Fingerprint(settings=settings_, code=code, inputs=inputs), births, defect) == reason


@pytest.mark.parametrize("place", ["folder", "memory://store-local"])
def test_a_file_of_an_export_is_read_by_its_path_or_missed_with_a_sentence(tmp_path, place):
    if place != "folder":
        pytest.importorskip("obstore")
    store = Store(tmp_path if place == "folder" else bucket_of(place))
    store.depot.put("parts/a.tif", b"tiles")
    with store.local("parts/a.tif") as path:
        assert path.read_bytes() == b"tiles"
    with pytest.raises(StoreError, match=r"parts/b\.tif is absent; run again"), store.local("parts/b.tif"):
        pass
