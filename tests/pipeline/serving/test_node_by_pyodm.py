"""The client that WebODM uses speaks to the node: upload in parts, progress, results, errors, and the end of a task."""

import json
import re
from pathlib import Path

import pytest
from pyodm.exceptions import NodeResponseError, TaskFailedError
from pyodm.types import TaskStatus

from benchmarks.serving.running_node import TOKEN, node, photographs


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    with node(tmp_path_factory.mktemp("node") / "home") as found:
        yield found


def test_a_block_goes_up_is_done_and_comes_down(running, tmp_path):
    client = running.client()
    files = photographs(tmp_path, ("a.jpg", "b.jpg", "c.jpg"))
    (tmp_path / "gcp_list.txt").write_text("EPSG:32634\n1 2 3 4 5 a.jpg\n")
    (tmp_path / "image_groups.txt").write_text("a.jpg 1\n")
    (tmp_path / "b_mask.jpg").write_bytes(Path(files[0]).read_bytes())
    sent = []
    options = {"dtm": False, "orthophoto-resolution": 5, "texture.best": 4, "auto-boundary": True, "orthophoto-png": True}
    given = [*files, *(str(tmp_path / name) for name in ("gcp_list.txt", "b_mask.jpg", "image_groups.txt"))]
    task = client.create_task(given, options, name="../a block", progress_callback=sent.append, parallel_uploads=4)
    assert sent[-1] == 100
    task.wait_for_completion(interval=0.1)
    info = task.info(with_output=0)
    assert (info.status, info.progress, info.images_count, info.name) == (TaskStatus.COMPLETED, 100, 3, "../a block")
    assert info.processing_time > 0 and {one["name"] for one in info.options} == set(options)
    text = "\n".join(info.output)
    assert "auto-boundary means nothing to orthomill" in text and "Not used: image_groups.txt" in text and "Verdict: Good" in text
    assert "127.0.0.1" not in text  # the address of the run's own map is nobody's business
    folder = running.home / "tasks" / task.uuid
    assert sorted(path.name for path in (folder / "images").iterdir()) == ["a.jpg", "b.jpg", "b_mask.jpg", "c.jpg", "gcp_list.txt"]
    workflow = (folder / "workflows" / "task.yaml").read_text()
    assert "terrain" not in workflow and "best: 4" in workflow
    got = Path(task.download_assets(str(tmp_path / "got")))
    assert (got / "odm_georeferencing" / "odm_georeferenced_model.laz").read_bytes() == b"points.laz" * 1000
    assert (got / "entwine_pointcloud" / "ept.json").exists()
    assert (got / "orthomill" / "dsm_check.tif").exists() and "Verdict" in (got / "task_output.txt").read_text()
    assert json.loads((got / "log.json").read_text())["verdict"] == "Good: checked."


def test_the_node_tells_what_it_is_and_what_can_be_set(running):
    client = running.client()
    info = client.info()
    assert info.engine == "orthomill" and client.version_greater_or_equal_than("2.2.0") and info.max_images is None
    options = {option.name: option for option in client.options()}
    assert {"dsm", "dtm", "orthophoto-resolution", "pc-quality", "boundary", "crs", "texture.best"} <= options.keys()
    assert options["texture.best"].domain == "integer: 0 <= x <= 64" and options["texture.balance"].domain[0] == "none"
    assert all(isinstance(option.value, str) and option.help for option in options.values()) and len(options) >= 50


def test_a_wrong_token_gets_nothing(running):
    for token in ("wrong", "s3cret", "s3cret-s3cre\u00e9"):
        with pytest.raises(NodeResponseError, match="Unauthorized"):
            running.client(token).info()


def test_wrong_options_are_refused_before_anything_is_uploaded(running, tmp_path):
    with pytest.raises(NodeResponseError, match=r"tile is '100'; it is a whole number.*\n.*crs is 'EPSG:x'"):
        running.client().create_task(photographs(tmp_path), {"tile": 100, "crs": "EPSG:x"})


def test_a_task_that_fails_says_why(running, tmp_path):
    task = running.client().create_task(photographs(tmp_path, ("bad.jpg", "b.jpg")), {})
    with pytest.raises(TaskFailedError):
        task.wait_for_completion(interval=0.1)
    info = task.info()
    assert info.status == TaskStatus.FAILED and info.last_error == "photos/bad.jpg: bad.jpg cannot be read."
    with pytest.raises(NodeResponseError, match="not been completed"):
        running.client().get(f"/task/{task.uuid}/download/all.zip")


def test_one_photograph_is_refused(running, tmp_path):
    with pytest.raises(NodeResponseError, match="1 photographs were uploaded; a task needs at least 2"):
        running.client().create_task(photographs(tmp_path, ("a.jpg",)), {})


def test_a_task_is_cancelled_begun_again_and_removed(running, tmp_path):
    client = running.client()
    task = client.create_task(photographs(tmp_path), {})
    assert task.cancel() and task.info().status == TaskStatus.CANCELED
    assert task.restart({"texture.best": 3, "rerun-from": "odm_orthophoto"})
    task.wait_for_completion(interval=0.1)
    assert [one["name"] for one in task.info().options] == ["texture.best"]
    assert "best: 3" in (running.home / "tasks" / task.uuid / "workflows" / "task.yaml").read_text()
    with pytest.raises(NodeResponseError, match="rerun-from is 'x'"):
        task.restart({"rerun-from": "x"})
    assert task.remove() and not (running.home / "tasks" / task.uuid).exists()
    with pytest.raises(NodeResponseError, match="not found"):
        task.info()


def test_the_client_of_the_documentation_works(running, tmp_path, monkeypatch):
    page = (Path(__file__).parents[3] / "docs" / "serve.md").read_text()
    program = page.split("```python\n")[1].split("```")[0]
    photographs(tmp_path / "flight")
    (tmp_path / "flight" / "gcp_list.txt").write_text("EPSG:32634\n")
    monkeypatch.chdir(tmp_path)
    values: dict = {}
    exec(program.replace("3000", str(running.port)).replace("the token of the node", TOKEN), values)
    assert (Path(values["folder"]) / "task_output.txt").exists()
    named = {option.name for option in running.client().options()}
    said = set(re.findall(r"`([a-z0-9-]+)`", page.split("| option | what it does here |")[1].split("A wrong value")[0]))
    assert said - named == {"false"}
    (again,) = (option for option in running.client().options() if option.name == "rerun-from")
    assert {"texture", "odm_orthophoto", "odm_dem"} <= set(again.domain) and again.domain[-1] == "odm_postprocess"
