"""What the map of tiles costs the scheduler and a browser: many tiles, of which some end ten times a second.

    python -m benchmarks tile_map [TILES] [TILES THAT END IN A SECOND]

The board and its routes run in this process, as they run in that of the scheduler; a headless Chromium shows the page.
"""

import asyncio
import os
import random
import shutil
import time
from threading import Thread

import psutil
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.web import Application

from orthomill.pipeline.report.paper import FLAGS
from orthomill.pipeline.watching.live_map import page_template
from orthomill.pipeline.watching.tile_board import Panel, TileBoard, TileState
from orthomill.pipeline.watching.tile_routes import tile_routes

PORT, PANELS, SECONDS, UPDATES = 8999, 4, 20.0, 10
FACTS = {"project": "benchmark", "share": 0.5, "left": 100, "error": 10, "elapsed": 5, "peak": 1, "limit": 2, "free": 3}


def full_board(count: int) -> TileBoard:
    """Square panels of two stages."""
    board, side = TileBoard("benchmark", {"surface": "Surface", "texture": "Orthoimage"}), int((count / PANELS) ** 0.5)
    for number in range(PANELS):
        stage = ("surface", "texture")[number % 2]
        panel = Panel(stage, f"raster {number}", (0.0, 1.0, 1.0, 0.0))
        for tile in range(side * side):
            board.add((stage, f"raster {number}", tile // side, tile % side), panel, tile % side, tile // side)
    return board


class BoardAlone:
    """Answers for a board without a run."""

    def __init__(self, board: TileBoard) -> None:
        self._board = board

    def changes(self, tiles: int, changes: int) -> dict[str, object]:
        """What has changed, and figures that stand still."""
        board, slowest = self._board, [[tile, str(tile)] for tile in self._board.slowest()]
        answer = board.since(tiles, changes) | {"titles": board.titles, "outlined": 0}
        return answer | {"total": FACTS | {"counts": board.counts(), "slowest": slowest}}

    def outlines(self) -> list[object]:
        """No photograph."""
        return []

    def tile(self, tile: int) -> None:
        """No job behind it."""

    def picture(self, tile: int) -> None:
        """No result behind it."""


def serve(board: TileBoard) -> None:
    """Answer pages as the scheduler does."""

    asyncio.set_event_loop(asyncio.new_event_loop())
    routes = tile_routes(page_template().replace('"KEPT"', '""'), BoardAlone(board))
    HTTPServer(Application(routes)).listen(PORT, "127.0.0.1")
    IOLoop.current().start()


def browser_seconds() -> float:
    """Processor time of all processes that this one has started, s."""
    return sum(sum(child.cpu_times()[:2]) for child in psutil.Process().children(recursive=True))


def main(words: list[str]) -> None:
    """Print what it costs."""
    from playwright.sync_api import sync_playwright

    count, ends = (int(word) for word in (*words, *("1000000", "200")[len(words) :]))
    memory = psutil.Process().memory_info().rss
    board = full_board(count)
    print(f"{len(board.keys)} tiles, {(psutil.Process().memory_info().rss - memory) / 2**20:.0f} MiB with their keys")
    Thread(target=serve, args=(board,), daemon=True).start()
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1366, "height": 900}, bypass_csp=True)
        begun = time.perf_counter()
        page.goto(f"http://127.0.0.1:{PORT}/tiles")
        page.wait_for_function(f"tiles >= {len(board.keys)}", timeout=300_000)
        print(f"first load: {time.perf_counter() - begun:.1f} s")
        page.wait_for_timeout(3000)
        page.evaluate("() => { globalThis.answered = 0; const known = apply; apply = answer => { answered++; known(answer); }; }")
        own, other, begun = time.process_time(), browser_seconds(), time.perf_counter()
        while time.perf_counter() - begun < SECONDS:
            for _ in range(ends // UPDATES):
                key = board.keys[random.randrange(len(board.keys))]
                board.started(key, "worker")
                board.ended(key, TileState.DONE, 1.0, 300.0)
            time.sleep(1 / UPDATES)
        passed = time.perf_counter() - begun
        print(f"scheduler's side: {100 * (time.process_time() - own) / passed:.1f} % of a core")
        print(f"browser, all processes: {100 * (browser_seconds() - other) / passed:.1f} % of a core")
        print(f"answers that the page drew: {page.evaluate('answered') / passed:.1f} a second")
        browser.close()
    os._exit(0)  # the server's thread has no end of its own
