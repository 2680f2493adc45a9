"""What strangers send: a thousand requests that know the routes end in sentences, and nobody reads anything without the token."""

import json
import random
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from benchmarks.serving.random_requests import ANSWERS, BOUNDARY, UUID, form, random_request
from benchmarks.serving.running_node import TOKEN, asked, node, photographs
from orthomill.pipeline.report.paper import FLAGS

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    with node(tmp_path_factory.mktemp("node") / "home", STANDIN_PAUSE="0") as found:
        yield found


@pytest.fixture(scope="module")
def done(running, tmp_path_factory):
    """A task that has ended."""
    return ended(running, tmp_path_factory.mktemp("photographs"))


def ended(running, folder: Path) -> str:
    task = running.client().create_task(photographs(folder), {}, name="<b>done</b>")
    task.wait_for_completion(interval=0.1)
    return task.uuid


def posted_form(running, path: str, *parts: tuple[str, str | None, bytes], token: str = TOKEN) -> dict:
    headers = {"Content_Type": f"multipart/form-data; boundary={BOUNDARY}"}
    status, content, _ = asked(running, "POST", f"{path}?token={token}", form(*parts), **headers)
    assert status == 200
    return json.loads(content)


def files_beside(home: Path) -> set[Path]:
    return {path for path in home.parent.rglob("*") if not path.is_relative_to(home)}


def test_a_thousand_requests_end_in_sentences(running, tmp_path):
    # A task of its own: requests by lot restart it and remove it.
    own = ended(running, tmp_path)
    chance, before = random.Random(43), files_beside(running.home)
    seen: dict[int, int] = {}
    uuids = [own]
    for _ in range(1000):
        method, path, body, headers = random_request(chance, [own, *uuids[-3:]])
        status, content, _ = asked(running, method, path, body, **headers)
        seen[status] = seen.get(status, 0) + 1
        assert status in ANSWERS, (method, path, content)
        leaked = [word for word in (b"Traceback", b"root:x:", TOKEN.encode()) if word in content]
        assert not leaked, (method, path, content)
        if status == 200 and content.startswith(b'{"uuid"'):
            uuids.append(json.loads(content)["uuid"])
    assert seen[200] > 300 and running.process.poll() is None
    assert files_beside(running.home) == before
    made = [path.name for folder in ("tasks", "uploads") for path in (running.home / folder).iterdir()]
    assert all(re.fullmatch(r"[0-9a-f-]{36}", name) for name in made) and len(made) > 3
    assert "Traceback" not in (running.home / "node.log").read_text()


def test_nothing_is_read_without_the_token(running, done):
    ticket = "0" * 40
    paths = ["/info", "/options", "/tasks.json", f"/task/{done}/info", f"/task/{done}/download/all.zip", f"/task/{done}/output"]
    for path in paths:
        for given in ("", "?token=", "?token=wrong-wrong-wrong", f"?token={TOKEN[:-1]}"):
            status, content, _ = asked(running, "GET", path + given)
            assert status == 401 and done.encode() not in content
    assert asked(running, "GET", f"/view/{ticket}/{done}/report.html")[0] == 404
    assert asked(running, "POST", "/task/remove", f'{{"uuid": "{done}"}}'.encode(), Content_Type="application/json")[0] == 401
    status, content, headers = asked(running, "GET", "/")
    assert status == 200 and b'name="token"' in content and "script-src" not in headers["content-security-policy"]
    assert asked(running, "GET", f"/task/x/?token={TOKEN}")[0] == 404  # and is not sent elsewhere
    assert asked(running, "GET", "/health")[1] == b'{"status":"ok"}'


def test_what_a_task_has_is_listed_as_scaleodm_lists_it(running, done):
    def listed(query: str = "", task: str = done) -> dict:
        return json.loads(asked(running, "GET", f"/task/{task}/assets?token={TOKEN}{query}")[1])

    primary = {one.pop("id"): one for one in listed()["primary"]}
    assert [kind for kind, one in primary.items() if one["exists"]] == ["all_zip", "point_cloud"]
    assert primary["dtm"] == {"asset": "odm_dem/dtm.tif", "exists": False} and "additional" not in listed()
    others = listed("&includeAdditional=true&additionalLimit=2")["additional"]
    assert len(others) == 2 and "whole number" in listed("&includeAdditional=true&additionalLimit=x")["error"]
    for one in (primary["all_zip"], primary["point_cloud"], *others):
        assert asked(running, "GET", f"{one['downloadUrl']}?token={TOKEN}", Range="bytes=0-0")[0] == 206
    assert "not found" in listed(task=UUID)["error"]


def test_parts_of_the_results_by_range(running, done):
    path = f"/task/{done}/download/all.zip?token={TOKEN}"
    whole = asked(running, "GET", path)[1]
    status, part, headers = asked(running, "GET", path, Range="bytes=10-19")
    assert (status, part) == (206, whole[10:20]) and headers["content-range"] == f"bytes 10-19/{len(whole)}"
    assert asked(running, "GET", f"/task/{done}/download/report.html?token={TOKEN}")[1] == b"<html><body>report</body></html>"


def cookie_of(running) -> str:
    status, _, headers = asked(running, "GET", f"/?token={TOKEN}")
    assert status == 303 and headers["location"] == "/" and "HttpOnly" in headers["set-cookie"]
    assert "SameSite=strict" in headers["set-cookie"] and TOKEN not in headers["set-cookie"]
    return headers["set-cookie"].split(";")[0]


def test_the_page_has_a_cookie_that_changes_nothing_without_its_header(running, done):
    cookie = cookie_of(running)
    status, page, headers = asked(running, "GET", "/", Cookie=cookie)
    assert status == 200 and b"<article" not in page and "unsafe" not in headers["content-security-policy"]
    told = json.loads(asked(running, "GET", "/tasks.json", Cookie=cookie)[1])
    assert [task["name"] for task in told["tasks"] if task["uuid"] == done] == ["<b>done</b>"]
    body = b'{"uuid": "00000000-0000-4000-8000-000000000000"}'
    assert asked(running, "POST", "/task/remove", body, Cookie=cookie, Content_Type="application/json")[0] == 401
    allowed = asked(running, "POST", "/task/remove", body, Cookie=cookie, Content_Type="application/json", X_Orthomill_Page="1")
    assert allowed[0] == 200 and b"not found" in allowed[1]


def test_pages_of_a_run_open_in_a_box(running, done):
    told = json.loads(asked(running, "GET", "/tasks.json", Cookie=cookie_of(running))[1])
    pages = {page["title"]: page["address"] for task in told["tasks"] if task["uuid"] == done for page in task["pages"]}
    assert pages.keys() == {"Report", "Map of tiles"}
    status, content, headers = asked(running, "GET", f"/{pages['Report']}")
    assert status == 200 and content == b"<html><body>report</body></html>"
    assert headers["content-security-policy"].startswith("sandbox allow-scripts")
    start = pages["Report"].removesuffix("report.html")
    assert asked(running, "GET", f"/{start}products/points.laz")[0] == 200
    for path in (
        "summary.json",
        "products/../../../task.json",
        "products/%2e%2e/%2e%2e/%2e%2e/task.json",
        ".lock",
        "map/tiles",
        "jobs/x",
    ):
        assert asked(running, "GET", f"/{start}{path}")[0] == 404, path


def test_an_upload_is_known_by_its_uuid_and_complete_when_it_is_acknowledged(running):
    uuid = posted_form(running, "/task/new/init", ("name", None, b"x"))["uuid"]
    assert "no multipart form" in json.loads(asked(running, "POST", f"/task/new/upload/{uuid}?token={TOKEN}", b"x")[1])["error"]
    told = posted_form(running, f"/task/new/upload/{uuid}", ("images", "../../up.jpg", b"1" * 100), ("images", "b.jpg", b"2"))
    assert told == {"success": True}
    images = running.home / "uploads" / uuid / "images"
    assert sorted(path.name for path in images.iterdir()) == ["b.jpg", "up.jpg"]
    cut = form(("images", "c.jpg", b"3" * 1000))[:300]
    kind = f"multipart/form-data; boundary={BOUNDARY}"
    status, content, _ = asked(running, "POST", f"/task/new/upload/{uuid}?token={TOKEN}", cut, Content_Type=kind)
    assert status == 200 and "middle of a file" in json.loads(content)["error"]
    assert sorted(path.name for path in images.iterdir()) == ["b.jpg", "up.jpg"]
    assert "no name for an uploaded file" in posted_form(running, f"/task/new/upload/{uuid}", ("images", "..", b""))["error"]
    assert "field 'images'" in posted_form(running, f"/task/new/upload/{uuid}", ("files", "a.jpg", b""))["error"]
    assert posted_form(running, f"/task/new/commit/{uuid}") == {"uuid": uuid} == posted_form(running, f"/task/new/commit/{uuid}")
    assert "not found" in posted_form(running, f"/task/new/upload/{uuid}", ("images", "d.jpg", b""))["error"]


def test_all_in_one_request(running):
    answer = posted_form(running, "/task/new", ("images", "a.jpg", b"1"), ("images", "b.jpg", b"2"), ("name", None, b"one"))
    assert json.loads(asked(running, "GET", f"/task/{answer['uuid']}/info?token={TOKEN}")[1])["name"] == "one"
    refused = posted_form(running, "/task/new", ("images", "a.jpg", b"1"), ("options", None, b'[{"name": "tile", "value": 1}]'))
    assert "tile is '1'" in refused["error"]
    waiting = posted_form(running, "/task/new", ("zipurl", None, b"http://127.0.0.1/x.zip"))
    assert "no object store" in waiting["error"]


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_the_page_in_a_real_browser(running, done, tmp_path):
    address = f"http://127.0.0.1:{running.port}/?token={TOKEN}"
    words = [
        CHROMIUM,
        *FLAGS,
        f"--user-data-dir={tmp_path}",
        "--enable-logging=stderr",
        "--virtual-time-budget=3000",
        "--dump-dom",
        address,
    ]
    shown = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert "&lt;b&gt;done&lt;/b&gt;" in shown.stdout and "Good: checked." in shown.stdout and ">all.zip</a>" in shown.stdout
    assert "CONSOLE" not in shown.stderr  # a script or a style that the policy refuses is told there
    asked_of_page = re.findall(r'href="(view/[^"]+)"', shown.stdout)
    assert len(asked_of_page) >= 2 and TOKEN not in shown.stdout
