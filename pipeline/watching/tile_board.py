"""The state of every tile of a run, and what has changed since somebody last looked.

A tile is a job, and has a number in the order of planning. Tiles of one stage that lie side by side form a panel: those of a
photograph, of a pair, of a map. States are kept in flat arrays and changes in a log of tile numbers, so that an answer costs as
much as has changed, and not as much as the run is large.
"""

import heapq
from array import array
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from threading import Lock
from typing import Any

from orthomill.pipeline.records.numbered_names import Key, NumberedKeys

SLOWEST = 5
"""tiles that are named as the slowest"""
MOST = 200_000
"""Tiles and changes in one answer; a page asks again at once where there are more."""


class TileState(IntEnum):
    """What a tile is doing. The numbers are those of the page's colours."""

    WAITING = 0
    RUNNING = 1
    DONE = 2
    UNCHANGED = 3
    RETRIED = 4
    FAILED = 5
    BLOCKED = 6


ENDED = frozenset((TileState.DONE, TileState.UNCHANGED, TileState.FAILED, TileState.BLOCKED))


@dataclass(frozen=True)
class Panel:
    """Tiles side by side: `stage` and `name`; `ground` is (west, north, east, south), m, where they lie on the map."""

    stage: str
    name: str
    ground: tuple[float, float, float, float] | None = None
    across: tuple[float, float] | None = None
    """tiles that the raster is wide and high; the last ones may be parts"""
    raster: str = ""
    """name of the raster that the tiles are parts of; empty for tiles that are none"""


class TileBoard:
    """Tiles with their states. Safe to be written by one thread and asked by another."""

    def __init__(self, run: str, titles: dict[str, str]) -> None:
        self.run, self.titles = run, titles
        self.keys = NumberedKeys()
        self._panels: dict[Panel, int] = {}
        self._place = array("i")
        """panel, column, row of every tile"""
        self._state, self._attempt, self._worker = bytearray(), bytearray(), array("h")
        self._seconds, self._memory = array("f"), array("f")
        self._workers: dict[str, int] = {}
        self._queues: dict[int, dict[int, None]] = {}
        """what every worker has got, in that order; a worker has one thread"""
        self._counts = [0] * len(TileState)
        self._slowest: list[tuple[float, int]] = []
        """heap of those that took longest: a million tiles are not looked through for every answer"""
        self._log = array("i")
        self._lock = Lock()

    def add(self, key: Key, panel: Panel, column: int, row: int) -> None:
        """A tile has been planned."""
        with self._lock:
            number = self._panels.setdefault(panel, len(self._panels))
            self.keys.add(key)
            self._place.extend((number, column, row))
            self._state.append(TileState.WAITING)
            self._counts[TileState.WAITING] += 1
            self._attempt.append(0)
            self._worker.append(-1)
            self._seconds.append(0.0)
            self._memory.append(0.0)

    def started(self, key: Key, worker: str) -> None:
        """A worker has got the tile. It runs when those that the worker got before have ended: Dask hands out far more at once.

        One that was running and is handed out again has failed, or its worker has.
        """
        with self._lock:
            tile = self.keys.find(key)
            # Dask may tell of the beginning after the session has told of the end.
            if tile is None or self._state[tile] in ENDED:
                return
            if self._state[tile] != TileState.WAITING:
                self._attempt[tile] = min(self._attempt[tile] + 1, 255)
                self._set(tile, TileState.RETRIED)
            self._leave(tile)
            self._worker[tile] = self._workers.setdefault(worker, len(self._workers))
            self._queues.setdefault(self._worker[tile], {})[tile] = None
            self._advance(self._worker[tile])

    def came_back(self, key: Key, failed: bool) -> None:
        """A worker has given the tile back: an attempt has failed, or the worker is lost with all that it had got."""
        with self._lock:
            tile = self.keys.find(key)
            if tile is None or self._state[tile] in ENDED:
                return
            self._queues.get(self._worker[tile], {}).pop(tile, None)
            if failed:
                self._attempt[tile] = max(self._attempt[tile], 1)
                self._set(tile, TileState.RUNNING)
                self._advance(self._worker[tile])

    def ended(self, key: Key, state: TileState, seconds: float = 0.0, mebibytes: float = 0.0, attempt: int = 0) -> None:
        """A tile has come to its end. Whatever Dask releases or forgets afterwards, it keeps this state.

        `attempt`: as its record tells, for a scheduler elsewhere does not.
        """
        with self._lock:
            tile = self.keys.number(key)
            self._seconds[tile], self._memory[tile] = seconds, mebibytes
            self._attempt[tile] = min(max(self._attempt[tile], attempt), 255)
            # A tile may end twice, where its result was found damaged.
            others = [one for one in self._slowest if one[1] != tile]
            self._slowest = heapq.nlargest(SLOWEST, [*others, (seconds, tile)])
            self._set(tile, state)
            self._leave(tile)

    def _leave(self, tile: int) -> None:
        """Take a tile from the queue of its worker, which goes on with the next one."""
        queue = self._queues.get(self._worker[tile], {})
        if tile in queue:
            del queue[tile]
            self._advance(self._worker[tile])

    def _advance(self, worker: int) -> None:
        first = next(iter(self._queues.get(worker, {})), None)
        if first is not None and self._state[first] == TileState.WAITING:
            self._attempt[first] = 1
            self._set(first, TileState.RUNNING)

    def _set(self, tile: int, state: TileState) -> None:
        self._counts[self._state[tile]] -= 1
        self._counts[state] += 1
        self._state[tile] = state
        self._log.append(tile)

    def panels(self) -> list[tuple[Panel, int]]:
        """All panels in the order of their numbers, with their tiles."""
        with self._lock:
            held = Counter(self._place[::3])
            return [(panel, held[number]) for panel, number in self._panels.items()]

    def counts(self) -> list[int]:
        """Tiles by state."""
        with self._lock:
            return list(self._counts)

    def slowest(self) -> list[int]:
        """The tiles that took longest."""
        with self._lock:
            return [tile for _, tile in self._slowest]

    def since(self, tiles: int, changes: int, text: Callable[[Key], str] | None = None) -> dict[str, Any]:
        """What a page that knows so many tiles and changes does not know yet; flat lists, whose rows are named beside them.

        tiles: (panel, column, row) each; changes: (tile, state, seconds, MiB, worker, attempt) each.
        """
        with self._lock:
            upto = min(len(self.keys), tiles + MOST)
            newest = min(len(self._log), changes + MOST)
            # A page knows no tile before it has been told of it: changes wait until all tiles are told.
            changed = sorted(set(self._log[changes:newest])) if upto == len(self.keys) else []
            flat: list[float] = []
            for tile in changed:
                numbers = (tile, self._state[tile], round(self._seconds[tile], 2), round(self._memory[tile]))
                flat.extend((*numbers, self._worker[tile], self._attempt[tile]))
            answer = {
                "run": self.run,
                "tiles": upto,
                "changes": newest if upto == len(self.keys) else changes,
                "more": upto < len(self.keys) or newest < len(self._log),
                "panels": [[panel.stage, panel.name, panel.ground, panel.across] for panel in self._panels],
                "places": self._place[3 * tiles : 3 * upto].tolist(),
                "changed": flat,
                "workers": list(self._workers),
            }
            return answer | ({"keys": [text(key) for key in self.keys[tiles:upto]]} if text else {})

    def key(self, tile: int) -> Key | None:
        """The job of a tile."""
        return self.keys[tile] if 0 <= tile < len(self.keys) else None
