"""The pages of the map of tiles: the map, what has changed since a page last asked, one tile with its record, and its picture."""

import gzip
import json
from collections.abc import Callable
from typing import Any, Protocol

from tornado.ioloop import IOLoop
from tornado.web import HTTPError, RequestHandler

Changes = Callable[[int, int], dict[str, Any]]
Outlines = Callable[[], list[Any]]


class Answers(Protocol):
    """Whoever knows the map."""

    def changes(self, tiles: int, changes: int) -> dict[str, Any]:
        """What has changed since so many tiles and changes were known."""

    def outlines(self) -> list[Any]:
        """What every photograph shows of the ground."""

    def tile(self, tile: int) -> dict[str, Any] | None:
        """One tile with its record and its inputs, by number; None where there is none."""

    def picture(self, tile: int) -> bytes | None:
        """A small picture of what a tile has written; None where it has written no raster."""


POLICY = "default-src 'none'; connect-src 'self'; img-src 'self' data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""The page loads nothing from elsewhere."""
SMALL = 1000
"""bytes below which compressing an answer is not worth its time"""


class _Page(RequestHandler):
    def initialize(self, page: str) -> None:
        self._text = page

    def get(self) -> None:
        self.set_header("Content-Security-Policy", POLICY)
        self.write(self._text)


class _Changes(RequestHandler):
    def initialize(self, changes: Changes) -> None:
        self._changes = changes

    def get(self) -> None:
        _answer(self, self._changes(_number(self, "tiles"), _number(self, "changes")))


class _Outlines(RequestHandler):
    def initialize(self, outlines: Outlines) -> None:
        self._outlines = outlines

    def get(self) -> None:
        _answer(self, {"outlines": self._outlines()})


class _Tile(RequestHandler):
    def initialize(self, tile: Callable[[int], dict[str, Any] | None]) -> None:
        self._tile = tile

    def get(self) -> None:
        if (found := self._tile(_number(self, "tile"))) is None:
            raise HTTPError(404)
        _answer(self, found)


class _Picture(RequestHandler):
    def initialize(self, picture: Callable[[int], bytes | None]) -> None:
        self._picture = picture

    async def get(self) -> None:
        # Reading a chunk takes milliseconds, in which the scheduler would serve no worker.
        content = await IOLoop.current().run_in_executor(None, self._picture, _number(self, "tile"))
        if content is None:
            raise HTTPError(404)
        self.set_header("Content-Type", "image/png")
        self.set_header("Cache-Control", "max-age=3600")
        self.write(content)


def _number(handler: RequestHandler, name: str) -> int:
    text = handler.get_query_argument(name, "0")
    if not text.isdecimal() or len(text) > 12:
        raise HTTPError(400)
    return int(text)


def _answer(handler: RequestHandler, value: dict[str, Any]) -> None:
    content = json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode()
    handler.set_header("Content-Type", "application/json; charset=utf-8")
    if len(content) > SMALL and "gzip" in handler.request.headers.get("Accept-Encoding", ""):
        handler.set_header("Content-Encoding", "gzip")
        content = gzip.compress(content, 1)
    handler.write(content)


def tile_routes(page: str, answers: Answers) -> list[tuple[str, type[RequestHandler], dict[str, Any]]]:
    """Routes for an application of tornado; the paths end in /tiles, /tiles.json, /outlines.json, /tile.json and /tile.png."""
    return [
        (r".*/tiles", _Page, {"page": page}),
        (r".*/tiles\.json", _Changes, {"changes": answers.changes}),
        (r".*/outlines\.json", _Outlines, {"outlines": answers.outlines}),
        (r".*/tile\.json", _Tile, {"tile": answers.tile}),
        (r".*/tile\.png", _Picture, {"picture": answers.picture}),
    ]
