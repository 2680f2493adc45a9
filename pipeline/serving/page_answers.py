"""What pages on this machine ask their server for: numbers within bounds, answers as JSON, and parts of photographs."""

import json
from typing import Any

from tornado.ioloop import IOLoop
from tornado.web import HTTPError, RequestHandler

from orthomill.pipeline.serving.marking.photograph_crops import LARGEST, PhotographCrops


class PageAnswer(RequestHandler):
    """An answer to a page."""

    def number(self, name: str, low: float, high: float) -> float:
        """A number of the query between these; anything else is a bad request."""
        try:
            value = float(self.get_query_argument(name))
        except ValueError:
            raise HTTPError(400) from None
        if not low <= value <= high:  # NaN as well
            raise HTTPError(400)
        return value

    def tell(self, value: Any) -> None:
        """Answer with JSON, which is asked for again each time."""
        self.set_header("Content-Type", "application/json; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.write(json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode())

    async def show(self, crops: PhotographCrops, size: tuple[int, int]) -> None:
        """Answer with the part of a photograph that the query names, `size` (width, height) px."""
        place = self.number("col", -1e6, 1e6), self.number("row", -1e6, 1e6)
        photo, scale = self.get_query_argument("photo", ""), self.number("scale", 1e-3, 64)
        found = await IOLoop.current().run_in_executor(None, crops.jpeg, photo, *place, scale, size)
        if found is None:
            raise HTTPError(404)
        self.set_header("Content-Type", "image/jpeg")
        self.set_header("Cache-Control", "private, max-age=3600")
        self.write(found)

    def side(self, name: str) -> int:
        """A side of such a part, px."""
        return round(self.number(name, 1, LARGEST))
