"""A folder and an object store give the same answers, and a run gives the same results in either."""

import json
import os

import numpy as np
import pytest

pytest.importorskip("obstore")

from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.records import leases
from orthomill.pipeline.records.leases import NAME, is_leased, leased
from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.records.records import Records
from orthomill.pipeline.records.verification import verify
from orthomill.pipeline.storage.depots.bucket import Bucket, bucket_of
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import NOTE, keep_in, noted
from orthomill.pipeline.storage.depots.kept_files import first_defect, keep
from orthomill.pipeline.storage.depots.scratch import fetched
from orthomill.pipeline.storage.depots.store_keys import hidden, options_of
from orthomill.schemas.errors import ResourceError, StoreError, WorkflowError
from tests.support.engine.toy_stages import SumStage, pixels, run_in, session_in


def memory(name: str) -> Bucket:
    return bucket_of(f"memory://{name}-{os.urandom(4).hex()}")


@pytest.fixture(params=["folder", "bucket"])
def depot(request, tmp_path):
    return Folder(tmp_path) if request.param == "folder" else memory("contract")


def test_what_is_put_is_found_and_what_is_removed_is_gone(depot):
    kept = depot.put("a/b/c.bin", b"0123456789")
    assert depot.get("a/b/c.bin") == b"0123456789" and depot.get("a/b/c.bin", 4) == b"456789"
    assert depot.kept("a/b/c.bin") == kept and depot.state("a/b/c.bin").size == 10 == depot.size("a/b/c.bin")
    with depot.writing("a/d.bin") as stream:
        stream.write(b"xyz")
    assert depot.kept("a/d.bin").size == 3 and depot.size("a") == 13 and depot.size("none") is None
    assert [name for name, _ in depot.entries("a")] == ["d.bin"] and depot.folders("a") == ["b"]
    assert list(depot.names("a")) == ["a/b/c.bin", "a/d.bin"]
    with depot.local("a/d.bin") as path:
        assert path.read_bytes() == b"xyz"
    depot.delete("a/d.bin")
    depot.delete("a/d.bin")
    depot.clear("a/b")
    depot.clear("a/b")
    assert depot.state("a/d.bin") is None and list(depot.names("")) == []
    with pytest.raises(FileNotFoundError):
        depot.get("a/d.bin")


def test_lines_are_appended_and_a_file_that_fails_is_not_there(depot):
    assert [depot.append("jobs/x.log", b"one\n"), depot.append("jobs/x.log", b"two\n")] == [4, 8]
    assert depot.get("jobs/x.log", 4) == b"two\n"
    with pytest.raises(RuntimeError), depot.writing("half") as stream:
        stream.write(b"half")
        raise RuntimeError
    with pytest.raises(RuntimeError), depot.product("products/half.tif"):
        raise RuntimeError
    assert depot.state("half") is None and depot.state("products/half.tif") is None


def test_a_product_is_kept_with_what_lies_beside_it_and_that_of_others(depot):
    for number in ("1", "2"):
        with depot.product(f"products/map/parts/{number}.json") as path:
            path.write_bytes(b"list")
            (path.parents[1] / number).write_bytes(b"tile")
    names = ["products/map/1", "products/map/2", "products/map/parts/1.json", "products/map/parts/2.json"]
    assert list(depot.names("products")) == names


def test_loss_and_damage_are_found(depot):
    depot.put("a", b"whole")
    files = keep(depot, ["a"])
    assert first_defect(depot, files) is None and first_defect(depot, files, thoroughly=True) is None
    depot.put("a", b"WHOLE")
    assert first_defect(depot, files) == ("a", "damaged")
    depot.put("a", b"whole")
    assert first_defect(depot, files) is None, "written again, the same by its content"
    depot.delete("a")
    assert first_defect(depot, files) == ("a", "missing")


def toy(root, store: Bucket) -> Session:
    (root / "runs" / "toy").mkdir(parents=True)
    (root / "runs" / "toy" / NOTE).write_text(store.address)
    return run_in(root)


def test_a_run_in_an_object_store_is_that_of_a_folder_bit_for_bit(tmp_path):
    store = memory("toy")
    assert not toy(tmp_path / "there", store).failures and not run_in(tmp_path / "here").failures
    np.testing.assert_array_equal(pixels(tmp_path / "there"), pixels(tmp_path / "here"))
    here = Folder(tmp_path / "here/runs/toy")
    results = [name for part in ("rasters.zarr", "tables", "products") for name in here.names(part)]
    assert results == [name for part in ("rasters.zarr", "tables", "products") for name in store.names(part)]
    differing = [name for name in results if here.get(name) != store.get(name)]
    assert {name.rpartition("/")[2] for name in differing} <= {"zarr.json"}, "birth marks alone differ"
    assert [path.name for path in (tmp_path / "there/runs/toy").iterdir()] == [NOTE], "nothing is left on the disk"


def test_a_second_run_does_nothing_and_what_was_damaged_is_done_again(tmp_path):
    store = memory("again")
    first = toy(tmp_path, store)
    assert not run_in(tmp_path).done and first.done
    Records(store).fold()
    assert sum(len(store.entries(f"jobs/{stage}")) for stage in store.folders("jobs")) == 3, "one object a stage"
    name = "rasters.zarr/smooth/numbers/c/0/0"
    content = store.get(name)
    store.put(name, content[:-1] + bytes([content[-1] ^ 1]))
    assert set(verify(tmp_path / "runs/toy").damaged) == {name}
    again = run_in(tmp_path)
    assert ("smooth", "tile", 0, 0) in again.done and len(again.done) < len(first.done) and store.get(name) == content
    assert not [key for key in again.done if key[0] == "source"]


def test_one_run_at_a_time_holds_the_lease(monkeypatch):
    store = memory("lease")
    monkeypatch.setattr(leases, "LEASE", 3.0)
    monkeypatch.setattr(leases, "RENEWED", 0.2)
    with leased(store, "toy"):
        assert is_leased(store)
        with pytest.raises(ResourceError, match=f"toy is already running .*process {os.getpid()}"), leased(store, "toy"):
            pass
    assert store.state(NAME) is None and not is_leased(store)


def test_the_lease_of_a_process_that_has_ended_is_taken(monkeypatch):
    store = memory("left")
    gone = {"host": "elsewhere", "boot": "x", "process": 1, "token": "t", "renewed": 3}
    store.put(NAME, json.dumps(gone).encode())
    monkeypatch.setattr(leases, "LEASE", 0.5)
    with leased(store, "toy"):
        assert json.loads(store.get(NAME))["process"] == os.getpid()


def test_a_create_whose_answer_was_lost_is_known_as_ones_own():
    store = memory("lost")
    assert store.create("a", b"mine") and store.create("a", b"mine") and not store.create("a", b"other")
    version = store.state("a").version
    assert store.replace("a", b"second", version) and store.replace("a", b"second", version)
    assert not store.replace("a", b"third", version) and store.get("a") == b"second"


def test_results_are_in_one_place(tmp_path):
    folder = tmp_path / "runs" / "toy"
    keep_in(folder, "memory://one/")
    keep_in(folder, "memory://one")
    assert noted(folder) == "memory://one/toy"
    with pytest.raises(WorkflowError, match="are kept in memory://one/toy; remove them first with 'orthomill clean toy'"):
        keep_in(folder, "memory://two")
    run_in(tmp_path / "disk")
    with pytest.raises(WorkflowError, match="are kept on this disk"):
        keep_in(tmp_path / "disk" / "runs" / "toy", "memory://one")
    with only_run(folder):
        assert bucket_of("memory://one/toy").state(NAME)


@pytest.mark.parametrize(
    "address", ["http://x/y", "s3://", "s3://key:secret@bucket/x", "s3://b/../c", "bucket/x", "s3://b/x?token=1"]
)
def test_what_is_no_place_is_refused_without_showing_a_password(address):
    with pytest.raises(WorkflowError, match="is no place for results") as refused:
        bucket_of(address)
    assert "secret" not in str(refused.value)


def test_keys_come_from_the_environment_or_the_usual_files_and_are_never_shown(tmp_path, monkeypatch):
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        monkeypatch.delenv(name)
    (tmp_path / "keys").write_text("[office]\naws_access_key_id = KEYOFOFFICE\naws_secret_access_key = secretofoffice\n")
    (tmp_path / "config").write_text("[profile office]\nregion = eu-south-1\nendpoint_url = http://127.0.0.1:1\n")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "keys"))
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "config"))
    monkeypatch.setenv("AWS_PROFILE", "office")
    found = options_of("s3")
    assert (found["aws_access_key_id"], found["region"], found["client_options"]["allow_http"]) == (
        "KEYOFOFFICE",
        "eu-south-1",
        True,
    )
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "another/secret")
    assert hidden("denied: KEYOFOFFICE secretofoffice another/secret\nmore") == "denied: *** *** ***"
    assert "KEYOFOFFICE" not in repr(bucket_of("s3://bucket/of-office").store)


def test_a_worker_fetches_a_photograph_once(tmp_path, monkeypatch):
    monkeypatch.setenv("ORTHOMILL_SCRATCH", str(tmp_path / "scratch"))
    store = memory("photos")
    store.put("inputs/x/a.jpg", b"first")
    root = fetched(store.address, "inputs/x/a.jpg", "photos/a.jpg")
    assert (root / "photos/a.jpg").read_bytes() == b"first" and fetched(store.address, "inputs/x/a.jpg", "photos/a.jpg") == root
    store.put("inputs/x/a.jpg", b"second")
    assert (fetched(store.address, "inputs/x/a.jpg", "photos/a.jpg") / "photos/a.jpg").read_bytes() == b"second"
    with pytest.raises(StoreError, match=r"photos/b.jpg is not in memory://photos"):
        fetched(store.address, "inputs/x/b.jpg", "photos/b.jpg")


def test_files_of_the_user_are_sent_once(tmp_path):
    store = memory("sent")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/a.jpg").write_bytes(b"photograph")
    (tmp_path / "runs/toy").mkdir(parents=True)
    (tmp_path / "runs/toy" / NOTE).write_text(store.address)
    session = session_in(tmp_path, SumStage())
    name = session.inputs.sent("photos/a.jpg")
    assert store.get(name) == b"photograph" and session_in(tmp_path, SumStage()).inputs.sent("photos/a.jpg") == name
    assert list(store.names("inputs")) == [name]
