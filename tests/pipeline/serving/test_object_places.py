"""Photographs from an object store and results into one, below the prefixes of the node; a folder stands in for the store."""

import pytest
import requests

from benchmarks.serving.running_node import TOKEN, node, photographs
from orthomill.pipeline.serving.outputs.asset_files import Asset
from orthomill.pipeline.serving.queue.object_places import allowed_address, apart, send_results, task_rules
from orthomill.pipeline.serving.queue.safe_archives import ArchiveLimits
from orthomill.pipeline.serving.queue.upload_names import belongs_beside
from orthomill.pipeline.storage.depots.fetched_photographs import FetchRules, fetched_photographs
from orthomill.pipeline.storage.photographs.file_kinds import FOREIGN_SUFFIXES, LIST_SUFFIXES
from orthomill.schemas.errors import ResourceError, WorkflowError

PREFIXES = ("s3://bucket/site", "gs://other/")
LIMITS = ArchiveLimits(files=5, file_bytes=2000, bytes=3000, reserve=0)


@pytest.mark.parametrize("address", ["s3://bucket/site", "s3://bucket/site/a/b/", "gs://other/x", "s3://bucket/site/a.zip"])
def test_places_below_a_prefix(address):
    assert allowed_address(address, PREFIXES) == address.rstrip("/")


@pytest.mark.parametrize(
    "address",
    [
        "s3://bucket",
        "s3://bucket/site2",
        "s3://bucket/site/../x",
        "s3://bucket/site/a?b",
        "s3://bucket/site/%2e%2e",
        "file:///etc",
        "",
    ],
)
def test_other_places_are_refused(address):
    with pytest.raises(WorkflowError, match="is no place for this node"):
        allowed_address(address, PREFIXES)
    with pytest.raises(WorkflowError, match="no object store"):
        allowed_address(address, ())


@pytest.fixture
def bucket(tmp_path):
    folder = tmp_path / "bucket"
    for name, size in (("100MEDIA/a.jpg", 10), ("101MEDIA/a.jpg", 20), ("gcp_list.txt", 5), ("notes.pdf", 9)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x" * size)
    return folder


def fetched(address: str, target, results: str = ""):
    return fetched_photographs(address, target, task_rules(address, results, LIMITS))


def test_photographs_and_lists_are_fetched_once_and_side_by_side(bucket, tmp_path):
    target = tmp_path / "images"
    target.mkdir()
    assert fetched(bucket.as_uri(), target) == (("a.jpg", "101MEDIA_a.jpg", "gcp_list.txt"), 3, 1)
    assert {path.name: path.stat().st_size for path in target.iterdir()} == {"a.jpg": 10, "101MEDIA_a.jpg": 20, "gcp_list.txt": 5}
    assert fetched(bucket.as_uri(), target).new == 0
    (bucket / "flight.zip").write_bytes(b"x" * 7)
    assert fetched(f"{bucket.as_uri()}/flight.zip", target) == (("flight.zip",), 1, 0)


def test_results_below_the_photographs_are_no_photographs(bucket, tmp_path):
    (bucket / "notes.pdf").unlink()
    for name in ("output/cameras.json", "older/odm_dem/dsm.tif"):
        (bucket / name).parent.mkdir(parents=True)
        (bucket / name).write_bytes(b"x")
    place = bucket.as_uri()
    assert fetched(place, tmp_path / "images", f"{place}/output") == (("a.jpg", "101MEDIA_a.jpg", "gcp_list.txt"), 3, 2)
    assert fetched(place, tmp_path / "images", f"{place}/out").left == 1
    with pytest.raises(WorkflowError, match="where the photographs lie; name a place of its own"):
        apart(place, place)
    apart("", "")


def test_what_is_too_much_is_a_sentence(bucket, tmp_path):
    (bucket / "big.tif").write_bytes(b"x" * 2001)
    with pytest.raises(WorkflowError, match=r"big\.tif has 0 MiB; one file may have"):
        fetched(bucket.as_uri(), tmp_path)
    (bucket / "big.tif").write_bytes(b"x" * 1990)
    (bucket / "notes.pdf").rename(bucket / "second.tif")
    (bucket / "second.tif").write_bytes(b"x" * 1990)
    with pytest.raises(WorkflowError, match="are taken at most"):
        fetched(bucket.as_uri(), tmp_path)
    for number in range(4):
        (bucket / f"{number}.jpg").touch()
    with pytest.raises(WorkflowError, match="holds more than 5 objects"):
        fetched(bucket.as_uri(), tmp_path)
    with pytest.raises(WorkflowError, match=r"x\.zip does not exist"):
        fetched((bucket / "absent").as_uri() + "/x.zip", tmp_path)
    full = FetchRules(reserve=2**60)
    with pytest.raises(ResourceError, match="stay free; make room"):
        fetched_photographs((bucket / "100MEDIA").as_uri(), tmp_path / "images", full)


def test_whatever_init_looks_for_beside_photographs_stays_beside_them():
    assert all(belongs_beside(f"points{suffix}") for suffix in LIST_SUFFIXES | FOREIGN_SUFFIXES)
    assert not belongs_beside("image_groups.txt") and not belongs_beside("notes.pdf")


def test_results_are_sent_to_their_places(bucket, tmp_path):
    (tmp_path / "dsm.tif").write_bytes(b"heights")
    assert send_results(f"{bucket.as_uri()}/out", [Asset(tmp_path / "dsm.tif", "odm_dem/dsm.tif")]) == 1
    assert (bucket / "out/odm_dem/dsm.tif").read_bytes() == b"heights"


def test_a_task_reads_from_a_store_and_writes_to_it_and_users_have_quotas(tmp_path):
    photographs(tmp_path / "bucket" / "flight")
    (tmp_path / "tokens.yaml").write_text(
        f"tokens:\n- {{name: ana, token: {TOKEN}, tasks: 1, gigabytes: 0.001, photographs: 2}}\n"
        f"- {{name: ben, token: {TOKEN}-of-ben}}\n"
    )
    place = (tmp_path / "bucket").as_uri()
    with node(
        tmp_path / "home", STANDIN_PREFIX=place, STANDIN_TOKENS=str(tmp_path / "tokens.yaml"), STANDIN_PAUSE="0.3"
    ) as running:
        fields = {"readS3Path": f"{place}/flight/", "writeS3Path": f"{place}/flight/results", "name": "from a store"}

        def asked(**given) -> dict:
            address = f"http://127.0.0.1:{running.port}/task/new"
            return requests.post(address, params={"token": TOKEN}, data=fields | given, timeout=60).json()

        assert "no place for this node" in asked(readS3Path="s3://elsewhere/x")["error"]
        task = running.client().get_task(asked()["uuid"])
        assert "have not ended, and you may have 1" in asked()["error"]
        other = running.client(f"{TOKEN}-of-ben")
        assert other.info().task_queue_count == 1
        task.wait_for_completion(interval=0.1)
        assert task.info().images_count == 2
        assert task.restart()
        task.wait_for_completion(interval=0.1)
        assert task.info().images_count == 2
        assert (tmp_path / "bucket/flight/results/odm_georeferencing/odm_georeferenced_model.laz").exists()
        # What belongs to one is not there for another.
        told = requests.get(f"http://127.0.0.1:{running.port}/task/list", params={"token": f"{TOKEN}-of-ben"}, timeout=60).json()
        assert told == []
        begun = requests.post(f"http://127.0.0.1:{running.port}/task/new/init", params={"token": TOKEN}, timeout=60).json()["uuid"]
        sent = {"images": ("big.tif", b"x" * 1_200_000)}
        address = f"http://127.0.0.1:{running.port}/task/new/upload/{begun}"
        refused = requests.post(address, params={"token": TOKEN}, files=sent, timeout=60).json()
        assert "exceeds the" in refused["error"] and refused["noRetry"]
