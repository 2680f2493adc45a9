"""The map of tiles of one run: fed by the session and the scheduler, served while it runs, kept as a page beside the report."""

import base64
import gzip
import json
import shutil
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from orthomill.pipeline.engine.graph import PlannedJob
from orthomill.pipeline.engine.runner import Finished, Runner
from orthomill.pipeline.engine.session import Session, key_text
from orthomill.pipeline.records.records import Key, Record
from orthomill.pipeline.storage.table_files import write_whole
from orthomill.pipeline.watching.cost_model import CostModel
from orthomill.pipeline.watching.tile_board import TileBoard, TileState
from orthomill.pipeline.watching.tile_places import TilePlaces
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Export, Raster, regions_of

MAP = "tiles.html"
"""The page that is kept, in the folder of the run"""
MIB = 2**20
STATES = {"done": TileState.DONE, "failed": TileState.FAILED, "blocked": TileState.BLOCKED}
MOST_INPUTS = 12
"""inputs of a tile that its panel lists"""


class LiveMap:
    """Watches a session, and answers a page."""

    def __init__(self, session: Session, model: CostModel, memory_limit: int) -> None:
        self.board = TileBoard(uuid.uuid4().hex[:8], {stage.kind: stage.title for stage in session.stages})
        self._session, self._model, self._limit = session, model, memory_limit
        self._places = TilePlaces(session.graph.specs)
        self._errors: dict[Key, str] = {}
        self._begun = time.monotonic()
        self._peak = 0

    def planned(self, planned: PlannedJob) -> None:
        """A job is on the map from now on."""
        self.board.add(planned.key, *self._places.place(planned))

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
        self.board.ended(finished.key, STATES[finished.status], record.seconds if record else 0.0, peak / MIB)

    def changes(self, tiles: int, changes: int) -> dict[str, Any]:
        """What has changed, and how far the run is."""
        return self.board.since(tiles, changes) | {"titles": self.board.titles, "total": self._total()}

    def _total(self) -> dict[str, Any]:
        left = self._model.remaining()
        return {
            "project": self._session.folder.name,
            "share": left.share if left else 0.0,
            "left": left.seconds if left else None,
            "error": left.error if left else None,
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
            return tile_picture(self._session.store, region.name, region.window) if region else None
        except StoreError:
            return None

    def kept_page(self) -> str:
        """The map as it is now, as a page that needs nobody to answer."""
        state: dict[str, Any] = {"more": True, "tiles": 0, "changes": 0}
        parts = []
        while state["more"]:
            state = self.board.since(state["tiles"], state["changes"], text=key_text)
            parts.append(state)
        errors = {key_text(key): sentence for key, sentence in self._errors.items()}
        whole = {"parts": parts, "titles": self.board.titles, "total": self._total(), "errors": errors}
        data = base64.b64encode(gzip.compress(json.dumps(whole, separators=(",", ":")).encode(), 6)).decode()
        return page_template().replace('"KEPT"', f'"{data}"')


def page_template() -> str:
    """The page of the map; the word KEPT in it stands for the data of a page that is kept."""
    return (Path(__file__).parent / "templates" / "tiles.html").read_text(encoding="utf-8")


@contextmanager
def live_map(session: Session, runner: Runner, model: CostModel, announce: Callable[[str], None]) -> Iterator[LiveMap]:
    """The map of a run: on the dashboard's port where it runs on Dask of this machine, and always kept at the end."""
    found = LiveMap(session, model, runner.memory_limit)
    if runner.dashboard and _served(found, runner):
        announce(f"map of tiles: {tiles_address(runner.dashboard)}")
    try:
        yield found
    finally:
        write_whole(session.folder / MAP, found.kept_page().encode())


def _served(found: LiveMap, runner: Runner) -> bool:
    from orthomill.pipeline.engine.dask_observer import observe
    from orthomill.pipeline.engine.dask_runner import DaskRunner
    from orthomill.pipeline.watching.tile_routes import tile_routes

    routes = tile_routes(page_template().replace('"KEPT"', '""'), found.changes, found.tile, found.picture)
    return isinstance(runner, DaskRunner) and observe(runner.client, found.board, routes)


def tiles_address(dashboard: str) -> str:
    """The address of the map beside that of the dashboard."""
    return f"{dashboard.removesuffix('status')}tiles"
