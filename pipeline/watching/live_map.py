"""The map of tiles of one run: fed by the session and the scheduler, served while it runs, kept as a page beside the report."""

import base64
import gzip
import json
import shutil
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.engine.run_facts import TILES
from orthomill.pipeline.engine.runner import Finished, Runner
from orthomill.pipeline.engine.running import write_for_the_user_only
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import Record, key_text
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.pipeline.watching.cost_model import CostModel
from orthomill.pipeline.watching.tile_board import TileBoard, TileState
from orthomill.pipeline.watching.tile_places import TilePlaces
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Export, Raster, regions_of
from orthomill.schemas.memory import MIB
from orthomill.schemas.stage_contract import Outline

MAP = "tiles.html"
"""The page that is kept, in the folder of the run"""
STATES = {"done": TileState.DONE, "failed": TileState.FAILED, "blocked": TileState.BLOCKED}
SAME = 0.5
"""seconds for which the total is not reckoned again"""
MOST_INPUTS = 12
"""inputs of a tile that its panel lists"""
KEPT_RECORDS, KEPT_PICTURES = 20_000, 4000
"""tiles whose records and inputs are kept, and whose pictures: a page of hundreds of megabytes is of no use to anybody"""


class LiveMap:
    """Watches a session, and answers a page."""

    def __init__(self, session: Session, model: CostModel, memory_limit: int) -> None:
        self.board = TileBoard(uuid.uuid4().hex[:8], {stage.kind: stage.title for stage in session.stages})
        self._session, self._model, self._limit = session, model, memory_limit
        self._places = TilePlaces(session.graph.specs)
        self._errors: dict[Key, str] = {}
        self._outlines: list[tuple[str, Outline]] = []
        """what the photographs show of the ground; known when the first tiles on the ground are planned"""
        self._begun = time.monotonic()
        self._peak = 0
        self._told: tuple[float, dict[str, Any]] | None = None

    def planned(self, planned: PlannedJob) -> None:
        """A job is on the map from now on."""
        panel, column, row = self._places.place(planned)
        self.board.add(planned.key, panel, column, row)
        if panel.ground and not self._outlines:
            self._outlines = list(self._session.outlines())

    def skipped(self, key: Key) -> None:
        """Unchanged since an earlier run: Dask never hears of it."""
        record = self._session.records.get(key)
        self.board.ended(key, TileState.UNCHANGED, record.seconds if record else 0.0, record.peak_bytes / MIB if record else 0.0)

    def finished(self, finished: Finished, record: Record | None) -> None:
        """A job has ended."""
        peak = record.peak_bytes if record else 0
        self._peak = max(self._peak, peak)
        if finished.sentence:
            self._errors[finished.key] = finished.sentence
        seconds, attempt = (record.seconds, record.attempt) if record else (0.0, 0)
        self.board.ended(finished.key, STATES[finished.status], seconds, peak / MIB, attempt)

    def changes(self, tiles: int, changes: int) -> dict[str, Any]:
        """What has changed, and how far the run is."""
        return self.board.since(tiles, changes) | {
            "titles": self.board.titles,
            "total": self._total_now(),
            "outlined": len(self._outlines),
        }

    def outlines(self) -> list[tuple[str, Outline]]:
        """What every photograph shows of the ground: its name, and corners (x, y)."""
        return self._outlines

    def _total_now(self) -> dict[str, Any]:
        # Pages ask ten times a second; nobody reads ten remaining times a second.
        now = time.monotonic()
        if self._told is None or now - self._told[0] > SAME:
            self._told = now, self._total()
        return self._told[1] | {"counts": self.board.counts()}

    def _total(self) -> dict[str, Any]:
        left = self._model.shown()
        return {
            "project": self._session.folder.name,
            "share": left.share if left else 0.0,
            "left": left.seconds if left else None,
            "range": left.range if left else None,
            "elapsed": time.monotonic() - self._begun,
            "counts": self.board.counts(),
            "slowest": [[tile, key_text(self.board.keys[tile])] for tile in self.board.slowest()],
            "peak": self._peak // MIB,
            "limit": self._limit // MIB,
            "free": shutil.disk_usage(self._session.folder).free // MIB,
        }

    def tile(self, tile: int) -> dict[str, Any] | None:
        """One tile with its record and its inputs; None where there is no such tile."""
        key = self.board.key(tile)
        if key is None:
            return None
        job, record = self._session.graph.jobs[key].job, self._session.records.get(key)
        inputs = (
            [] if isinstance(job, Export) else [repr(region) for reading in job.reads.values() for region in regions_of(reading)]
        )
        return {
            "key": key_text(key),
            "reason": self._session.reasons.get(key, "unchanged"),
            "error": self._errors.get(key, record.error if record else ""),
            "inputs": inputs[:MOST_INPUTS],
            "more": max(len(inputs) - MOST_INPUTS, 0),
            "record": None
            if record is None
            else {
                "status": record.status,
                "seconds": round(record.seconds, 2),
                "processor seconds": round(record.cpu_seconds, 2),
                "worker": record.worker,
                "peak memory (MiB)": record.peak_bytes // MIB,
                "fingerprint": record.fingerprint.text,
            },
        }

    def picture(self, tile: int) -> bytes | None:
        """A small picture of what a tile has written; None where it has written no raster."""
        # OpenCV is loaded when somebody looks.
        from orthomill.pipeline.watching.tile_picture import tile_picture

        key = self.board.key(tile)
        job = self._session.graph.jobs[key].job if key else None
        if job is None or isinstance(job, Export):
            return None
        region = next((region for region in job.writes.values() if isinstance(region, Raster)), None)
        try:
            return tile_picture(self._session.store, self._session.graph.specs[region.name], region.window) if region else None
        except StoreError:
            return None

    def kept_page(self) -> str:
        """The map as it is now, as a page that needs nobody to answer."""
        state: dict[str, Any] = {"more": True, "tiles": 0, "changes": 0}
        parts = []
        while state["more"]:
            state = self.board.since(state["tiles"], state["changes"], text=key_text)
            parts.append(state)
        whole = {
            "parts": parts,
            "titles": self.board.titles,
            "total": self._total(),
            "errors": {key_text(key): sentence for key, sentence in self._errors.items()},
            "outlines": self._outlines,
            "details": [self.tile(tile) for tile in range(min(len(self.board.keys), KEPT_RECORDS))],
            "pictures": dict(self._kept_pictures()),
        }
        data = base64.b64encode(gzip.compress(json.dumps(whole, separators=(",", ":")).encode(), 6)).decode()
        return page_template().replace('"KEPT"', f'"{data}"')

    def _kept_pictures(self) -> Iterator[tuple[int, str]]:
        """Numbers of panels and the pictures of their rasters: of the ground first, until there are enough."""
        from orthomill.pipeline.watching.tile_picture import raster_picture

        left = KEPT_PICTURES
        panels = sorted(enumerate(self.board.panels()), key=lambda numbered: numbered[1][0].ground is None)
        for number, (panel, tiles) in panels:
            if panel.raster and tiles <= left:
                left -= tiles
                # A run that was stopped may not have begun a raster, and a damaged one is told elsewhere.
                with suppress(StoreError):
                    yield (
                        number,
                        base64.b64encode(raster_picture(self._session.store, self._session.graph.specs[panel.raster])).decode(),
                    )


def page_template() -> str:
    """The page of the map; the word KEPT in it stands for the data of a page that is kept."""
    return (Path(__file__).parent / "templates" / "tiles.html").read_text(encoding="utf-8")


@contextmanager
def live_map(session: Session, runner: Runner, model: CostModel, announce: Callable[[str], None]) -> Iterator[LiveMap]:
    """The map of a run: on the dashboard's port where it runs on Dask of this machine, and always kept at the end."""
    found, held = LiveMap(session, model, runner.memory_limit), session.folder / TILES
    with ExitStack() as stack:
        if address := _served(found, runner, stack):
            write_for_the_user_only(held, address)
            announce(f"map of tiles: {address}")
        try:
            yield found
        finally:
            held.unlink(missing_ok=True)
            write_whole(session.folder / MAP, found.kept_page().encode())


def _served(found: LiveMap, runner: Runner, stack: ExitStack) -> str:
    """The address of the map; empty for a run without Dask, which has no second process that could answer meanwhile."""
    from orthomill.pipeline.engine.dask_observer import EachJob, asking, observe
    from orthomill.pipeline.engine.dask_runner import DaskRunner
    from orthomill.pipeline.watching.map_server import served
    from orthomill.pipeline.watching.tile_routes import tile_routes

    if not isinstance(runner, DaskRunner):
        return ""
    routes = tile_routes(page_template().replace('"KEPT"', '""'), found)
    board = EachJob(found.board, runner.jobs_of)
    if observe(runner.client, board, routes, "tiles"):
        return f"{runner.dashboard.removesuffix('status')}tiles"
    stack.enter_context(asking(runner.client, board))
    return stack.enter_context(served(routes))
