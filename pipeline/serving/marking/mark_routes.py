"""The paths of the page of marks: the page, what is known, changes, and parts of photographs."""

from pathlib import Path
from typing import Any

from pydantic import ValidationError
from tornado.ioloop import IOLoop
from tornado.web import HTTPError, RequestHandler

from orthomill.pipeline.serving.marking.mark_ledger import CHANGES, OvertakenError
from orthomill.pipeline.serving.marking.marking_session import MarkingSession
from orthomill.pipeline.serving.page_answers import PageAnswer
from orthomill.schemas.errors import OrthomillError

POLICY = "default-src 'none'; connect-src 'self'; img-src 'self' data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""The page loads nothing from elsewhere."""
MOST_BYTES = 1_000_000
"""of one change"""


class _MarkPage(RequestHandler):
    def initialize(self, page: str) -> None:
        self._text = page

    def get(self) -> None:
        self.set_header("Content-Security-Policy", POLICY)
        self.set_header("Cache-Control", "no-store")
        self.write(self._text)


class _AskedOfMarks(PageAnswer):
    """Answers that take more than a moment are computed beside the loop."""

    def initialize(self, session: MarkingSession) -> None:
        self.session = session

    async def answered(self, function, *arguments) -> Any:
        try:
            return await IOLoop.current().run_in_executor(None, function, *arguments)
        except OvertakenError as error:
            self.set_status(409)
            return {"error": str(error), **self.session.state()}
        except OrthomillError as error:
            self.set_status(400)
            return {"error": str(error)}


class _Photographs(_AskedOfMarks):
    def get(self) -> None:
        self.tell(self.session.photographs())


class _State(_AskedOfMarks):
    async def get(self) -> None:
        self.tell(await self.answered(self.session.state, int(self.number("known", 0, 1e15))))


class _Sights(_AskedOfMarks):
    async def get(self) -> None:
        self.tell(await self.answered(self.session.sights, self.get_query_argument("point", "")))


class _Proposals(_AskedOfMarks):
    async def get(self) -> None:
        self.tell(await self.answered(self.session.proposals, self.get_query_argument("point", "")))


class _NextPoints(_AskedOfMarks):
    async def post(self) -> None:
        self.tell(await self.answered(self.session.next_points))


class _ChangeMade(_AskedOfMarks):
    async def post(self) -> None:
        # A form of another site can send text, but not this type without being asked first.
        if not self.request.headers.get("Content-Type", "").startswith("application/json") or len(self.request.body) > MOST_BYTES:
            raise HTTPError(400)
        try:
            change = CHANGES.validate_json(self.request.body)
        except ValidationError as error:
            self.set_status(400)
            first = error.errors()[0]
            self.tell({"error": f"{'.'.join(map(str, first['loc'][1:])) or 'The change'}: {first['msg']}."})
            return
        self.tell(await self.answered(self.session.change, change))


class _Crop(_AskedOfMarks):
    async def get(self) -> None:
        await self.show(self.session.crops, (self.side("w"), self.side("h")))


def mark_routes(session: MarkingSession) -> list[tuple[str, type[RequestHandler], dict[str, Any]]]:
    """Routes for an application of tornado, below its secret; the page ends in /marks."""
    page = (Path(__file__).parent / "templates" / "marks.html").read_text(encoding="utf-8")
    asked = {"session": session}
    return [
        (r".*/marks", _MarkPage, {"page": page}),
        (r".*/photographs\.json", _Photographs, asked),
        (r".*/state\.json", _State, asked),
        (r".*/sights\.json", _Sights, asked),
        (r".*/proposals\.json", _Proposals, asked),
        (r".*/next", _NextPoints, asked),
        (r".*/change", _ChangeMade, asked),
        (r".*/crop\.jpg", _Crop, asked),
    ]
