"""Maps of runs that go on are asked of the run's own server, and of nobody else."""

import json

import pytest

from orthomill.pipeline.serving.node.run_pages import live_answer, pages, viewed_file
from orthomill.pipeline.serving.queue.task_folder import TaskFolder
from orthomill.pipeline.watching.map_server import served
from orthomill.pipeline.watching.tile_routes import tile_routes


class Known:
    """A map of one tile."""

    def changes(self, tiles: int, changes: int) -> dict:
        return {"tiles": tiles, "changes": changes}

    def outlines(self) -> list:
        return []

    def tile(self, tile: int) -> dict | None:
        return {"tile": tile} if tile == 1 else None

    def picture(self, tile: int) -> bytes | None:
        return b"\x89PNG"


@pytest.fixture
def folder(tmp_path):
    found = TaskFolder(tmp_path / "task")
    (found.run / "jobs").mkdir(parents=True)
    (found.run / "products").mkdir()
    return found


def test_the_live_map_is_passed_on_and_nothing_else(folder):
    assert live_answer(folder, "tiles", "") is None and pages(folder, True) == []
    with served(tile_routes("<html>map</html>", Known())) as address:
        (folder.run / "jobs/tiles.txt").write_text(address)
        assert [page["title"] for page in pages(folder, True)] == ["Map of tiles, live"] and pages(folder, False) == []
        whole = live_answer(folder, "tiles", "")
        assert whole is not None and whole.content == b"<html>map</html>" and whole.kind.startswith("text/html")
        changed = live_answer(folder, "tiles.json", "tiles=3&changes=4")
        assert changed is not None and json.loads(changed.content) == {"tiles": 3, "changes": 4}
        assert live_answer(folder, "tile.png", "tile=1") is not None
        for name, query in (("tile.json", "tile=2"), ("status", ""), ("../x", ""), ("tiles", "a b"), ("tiles.json", "x=http://y")):
            assert live_answer(folder, name, query) is None
    assert live_answer(folder, "tiles", "") is None  # nobody listens any more
    for elsewhere in ("http://192.0.2.1:80/x/tiles", "https://127.0.0.1.example.org/tiles", "http://127.0.0.1/tiles", "x", ""):
        (folder.run / "jobs/tiles.txt").write_text(elsewhere)
        assert live_answer(folder, "tiles", "") is None


def test_only_pages_and_products_are_shown(folder, tmp_path):
    for path in ("report.html", "summary.json", "products/index.html", "products/deep/a.js"):
        (folder.run / path).parent.mkdir(parents=True, exist_ok=True)
        (folder.run / path).write_text(path)
    (tmp_path / "secret").write_text("x")
    (folder.run / "products/link").symlink_to(tmp_path / "secret")
    assert [page["title"] for page in pages(folder, False)] == ["Report", "Map viewer"]
    for path in ("report.html", "products/index.html", "products/deep/a.js"):
        assert viewed_file(folder, path) == (folder.run / path).resolve()
    for path in (
        "summary.json",
        "products/link",
        "products/../summary.json/../../../secret",
        "products",
        "products/none",
        "/etc/passwd",
    ):
        assert viewed_file(folder, path) is None, path
