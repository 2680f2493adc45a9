"""The node's own page: tasks as they go on, with links to the pages and maps of their runs. Nothing comes from elsewhere."""

import hashlib
import hmac
from base64 import b64encode
from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from orthomill.pipeline.serving.node.access import COOKIE, Token
from orthomill.pipeline.serving.node.node_routes import bearer
from orthomill.pipeline.serving.node.node_service import NodeService
from orthomill.pipeline.serving.node.request_fields import fields_of, text_of
from orthomill.pipeline.serving.node.run_pages import HEADERS, live_answer, pages, viewed_file
from orthomill.pipeline.serving.queue.task_folder import TaskFolder
from orthomill.pipeline.serving.queue.task_state import TaskStatus
from orthomill.schemas.errors import WorkflowError

TEMPLATES = Path(__file__).parent / "templates"
POLICY = (
    "default-src 'none'; connect-src 'self'; img-src 'self' data:; frame-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
MOST_TASKS = 500
"""that the page shows"""
MONTH = 30 * 86_400


def own_policy(page: str) -> str:
    """The policy of a page of ours: its one script and its one style by their digests, answers of this site, nothing else."""
    found = {tag: page.split(f"<{tag}>", 1)[1].split(f"</{tag}>", 1)[0] for tag in ("script", "style") if f"<{tag}>" in page}
    kinds = [f"{tag}-src 'sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" for tag, text in found.items()]
    return "; ".join([POLICY, *kinds])


class NodePages:
    """The routes of pages for people."""

    def __init__(self, service: NodeService) -> None:
        self._service = service
        self._tasks, self._login = ((TEMPLATES / f"{name}.html").read_text(encoding="utf-8") for name in ("tasks", "login"))

    def routes(self) -> list[Route]:
        """All of them."""
        return [
            Route("/", self._page),
            Route("/login", self._enter, methods=["POST"]),
            Route("/tasks.json", self._listed),
            Route("/view/{ticket}/{uuid}/{path:path}", self._viewed),
        ]

    async def _page(self, request: Request) -> Response:
        token = request.state.token
        if token is None:
            return _own(self._login, 401 if "token" in request.query_params else 200)
        if "token" in request.query_params:
            return self._with_cookie(request, token)
        return _own(self._tasks)

    def _with_cookie(self, request: Request, token: Token) -> Response:
        """The page without the token in its address, which stays in no history."""
        answer = RedirectResponse("/", 303)
        secure, cookie = request.url.scheme == "https", self._service.access.cookie(token)
        answer.set_cookie(COOKIE, cookie, httponly=True, samesite="strict", secure=secure, max_age=MONTH)
        return answer

    async def _enter(self, request: Request) -> Response:
        try:
            given = text_of(await fields_of(request), "token", 300)
        except WorkflowError:
            given = ""
        token = self._service.access.bearer(given)
        return _own(self._login, 401) if token is None else self._with_cookie(request, token)

    async def _listed(self, request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(self._list, bearer(request)))

    def _list(self, token: Token) -> dict:
        tasks = []
        for state in self._service.tasks(token)[:MOST_TASKS]:
            folder = self._service.queue.of(state.uuid)
            progress, end = folder.progress(), folder.end() if state.status == TaskStatus.COMPLETED else None
            start = f"view/{self._service.access.ticket(token, state.uuid)}/{state.uuid}/"
            shown = [{**page, "address": f"{start}{page['path']}"} for page in pages(folder, state.status == TaskStatus.RUNNING)]
            more = {
                "stage": progress.stage,
                "left": progress.left_seconds,
                "bytes": state.bytes,
                "pages": shown,
                "verdict": end.verdict if end else "",
            }
            tasks.append({**self._service.told(state, -3), **more})
        return {"tasks": tasks, "trouble": self._service.queue.trouble, "user": token.name}

    async def _viewed(self, request: Request) -> Response:
        folder, path = self._opened(request), request.path_params["path"]
        if folder is None:
            return JSONResponse({"error": "There is no such page."}, 404)
        if path.startswith("map/"):
            answer = await run_in_threadpool(live_answer, folder, path.removeprefix("map/"), request.url.query)
            if answer is not None:
                return Response(answer.content, 200, HEADERS, answer.kind)
        elif (found := await run_in_threadpool(viewed_file, folder, path)) is not None:
            return FileResponse(found, headers=HEADERS)
        return JSONResponse({"error": "There is no such page."}, 404, HEADERS)

    def _opened(self, request: Request) -> TaskFolder | None:
        """The task whose ticket is in the address."""
        uuid = request.path_params["uuid"]
        state = self._service.queue.tasks.get(uuid)
        token = self._service.access.named(state.owner) if state else None
        given = request.path_params["ticket"].encode(errors="replace")
        if token is None or not hmac.compare_digest(self._service.access.ticket(token, uuid).encode(), given):
            return None
        return self._service.queue.of(uuid)


def _own(page: str, status: int = 200) -> Response:
    return HTMLResponse(page, status, {"content-security-policy": own_policy(page)})
