"""The map of a run whose scheduler is of another process: this process answers, and asks what the workers do."""

import time
import urllib.error
import urllib.request

import pytest
from toy_stages import MEMORY

from benchmarks.watching.tile_map import BoardAlone, full_board
from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.pipeline.engine.dask_observer import asking, observe
from orthomill.pipeline.watching.map_server import served
from orthomill.pipeline.watching.tile_routes import tile_routes


class FewJobs:
    """What a client knows of a scheduler elsewhere; a job goes from one worker to another."""

    def __init__(self):
        self.asked = 0

    def processing(self):
        self.asked += 1
        return {"tcp://b" if self.asked > 2 else "tcp://a": (("source", "tile", 0, 1, "run-1"), "of another program")}


class Notes:
    """Whoever is told of jobs."""

    def __init__(self):
        self.told = []

    def started(self, key, worker):
        self.told.append((key, worker))

    def came_back(self, key, failed):
        raise AssertionError("a scheduler that is only asked does not tell this")


def test_what_workers_elsewhere_have_got_is_told_once(monkeypatch):
    monkeypatch.setattr("orthomill.pipeline.engine.dask_observer.ASKED", 0.01)
    client, notes = FewJobs(), Notes()
    with asking(client, notes):
        while client.asked < 5:
            time.sleep(0.01)
    key = ("source", "tile", 0, 1)
    assert notes.told == [(key, "tcp://a"), (key, "tcp://b")]


def test_the_map_is_behind_a_secret_and_gone_afterwards():
    with served(tile_routes("the page", BoardAlone(full_board(16)))) as address:
        with urllib.request.urlopen(address, timeout=10) as answer:
            assert answer.read() == b"the page"
        with urllib.request.urlopen(address.replace("/tiles", "/outlines.json"), timeout=10) as answer:
            assert answer.read() == b'{"outlines":[]}'
        port = address.split("/")[2]
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"http://{port}/tiles", timeout=10)
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(address, timeout=10)


@pytest.mark.slow
def test_the_menu_of_dask_begins_with_the_map_and_does_not_lead_to_the_graph():
    with local_client(1, MEMORY, 8950) as client:
        assert observe(client, Notes(), tile_routes("the page", BoardAlone(full_board(4))), "tiles")
        with urllib.request.urlopen(client.dashboard_link, timeout=60) as answer:
            menu = answer.read().decode()
        with urllib.request.urlopen(client.dashboard_link.replace("/status", "/tiles"), timeout=20) as answer:
            assert answer.read() == b"the page"
    assert '<a href="tiles">' in menu and '<a href="status">' in menu and '<a href="graph">' not in menu
