"""The node's own page: tasks as they go on, with links to the pages and maps of their runs. Nothing comes from elsewhere."""

import hashlib
from base64 import b64encode
from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from orthomill.pipeline.serving.node.access import COOKIE, Token
from orthomill.pipeline.serving.node.node_routes import bearer, told
from orthomill.pipeline.serving.node.node_service import NodeService, page_file
from orthomill.pipeline.serving.node.request_fields import fields_of, text_of
from orthomill.schemas.errors import WorkflowError

TEMPLATES = Path(__file__).parent / "templates"
RESULT = (
    "sandbox allow-scripts allow-popups allow-downloads; default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; "
    + ("script-src 'unsafe-inline'; font-src data:; frame-ancestors 'none'")
)
"""policy of pages that hold names of files and photographs: in a box of their own they have no cookie and reach nothing"""


OWN_PAGE = (
    "default-src 'none'; connect-src 'self'; img-src 'self' data:; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)


def own_policy(page: str) -> str:
    """The policy of a page of ours: its one script and its one style by their digests, answers of this site, nothing else."""
    digests = {
        tag: _digest(page.split(f"<{tag}>", 1)[1].split(f"</{tag}>", 1)[0]) for tag in ("script", "style") if f"<{tag}>" in page
    }
    kinds = "; ".join(f"{tag}-src '{digest}'" for tag, digest in digests.items())
    return f"{OWN_PAGE}; {kinds}"


def _digest(text: str) -> str:
    return "sha256-" + b64encode(hashlib.sha256(text.encode()).digest()).decode()


class NodePages:
    """The routes of pages for people."""

    def __init__(self, service: NodeService) -> None:
        self._service = service
        self._tasks = (TEMPLATES / "tasks.html").read_text(encoding="utf-8")
        self._login = (TEMPLATES / "login.html").read_text(encoding="utf-8")

    def routes(self) -> list[Route]:
        """All of them."""
        return [
            Route("/", self._page),
            Route("/login", self._enter, methods=["POST"]),
            Route("/tasks.json", self._listed),
            Route("/task/{uuid}/page/{name}", told(self._result)),
        ]

    async def _page(self, request: Request) -> Response:
        token = request.state.token
        if token is None:
            return self._own(self._login, 401 if "token" in request.query_params else 200)
        if "token" in request.query_params:
            return self._with_cookie(request, token)
        return self._own(self._tasks)

    def _own(self, page: str, status: int = 200) -> Response:
        return HTMLResponse(page, status, {"content-security-policy": own_policy(page)})

    def _with_cookie(self, request: Request, token: Token) -> Response:
        """The page without the token in its address, which stays in no history."""
        answer = RedirectResponse("/", 303)
        secure = request.url.scheme == "https"
        answer.set_cookie(
            COOKIE, self._service.access.cookie(token), httponly=True, samesite="strict", secure=secure, max_age=30 * 86_400
        )
        return answer

    async def _enter(self, request: Request) -> Response:
        try:
            given = text_of(await fields_of(request), "token", 300)
        except WorkflowError:
            given = ""
        token = self._service.access.bearer(given)
        return self._own(self._login, 401) if token is None else self._with_cookie(request, token)

    async def _listed(self, request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(self._list, bearer(request)))

    def _list(self, token: Token) -> dict:
        queue = self._service.queue
        tasks = []
        for state in self._service.tasks(token)[:500]:
            folder = queue.of(state.uuid)
            progress = folder.progress()
            pages = [name for name in ("report.html", "tiles.html") if page_file(folder, name)]
            more = {"stage": progress.stage, "left": progress.left_seconds, "bytes": state.bytes, "pages": pages}
            tasks.append({**self._service.told(state, -3), **more})
        return {"tasks": tasks, "trouble": queue.trouble, "user": token.name}

    async def _result(self, request: Request) -> Response:
        state = self._service.task(bearer(request), request.path_params["uuid"])
        path = page_file(self._service.queue.of(state.uuid), request.path_params["name"])
        if path is None:
            raise WorkflowError("The task has no such page yet.")
        return FileResponse(path, media_type="text/html; charset=utf-8", headers={"content-security-policy": RESULT})
