"""The node as an application: every request passes the guard, every answer says that it is for this site and nobody else's."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import anyio
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from orthomill.pipeline.serving.node.access import CHANGES, COOKIE, Access, Token
from orthomill.pipeline.serving.node.node_routes import NodeRoutes
from orthomill.pipeline.serving.node.node_service import NodeService

WRONG = "Invalid authentication token. Do you need to add a ?token=???"
OPEN = frozenset({"/", "/login", "/health"})
"""paths that answer without a token, and tell nothing of the tasks"""
VIEW = "/view/"
"""paths that have a ticket in them"""
NOTHING = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
"""policy of what is no page"""
LOOK_EVERY, TIDY_EVERY = 0.5, 600.0
"""seconds"""


class TokenGuard:
    """Finds out whose a request is; what needs a token and has none goes no further."""

    def __init__(self, application: ASGIApp, access: Access) -> None:
        self._application, self._access = application, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http":
            await self._application(scope, receive, send)
            return
        token = self._token(HTTPConnection(scope))
        scope.setdefault("state", {})["token"] = token
        answer: ASGIApp = self._application
        if token is None and scope["path"] not in OPEN and not scope["path"].startswith(VIEW):
            answer = JSONResponse({"error": WRONG}, 401)
        await answer(scope, receive, _with_headers(send))

    def _token(self, connection: HTTPConnection) -> Token | None:
        given = connection.query_params.get("token")
        if given is not None:
            return self._access.bearer(given)
        # The cookie goes along with whatever this site is asked for; only the page itself can add a header.
        if connection.scope["method"] not in ("GET", "HEAD") and CHANGES not in connection.headers:
            return None
        return self._access.visitor(connection.cookies.get(COOKIE, ""))


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.setdefault("content-security-policy", NOTHING)
            headers.setdefault("cache-control", "no-store")
            headers["x-content-type-options"] = "nosniff"
            headers["referrer-policy"] = "no-referrer"
            headers.setdefault("cross-origin-resource-policy", "same-origin")
        await send(message)

    return sent


async def _health(request: Request) -> Response:
    return JSONResponse({"status": "ok"})


def node_application(service: NodeService, pages: list[Route], tidy: Callable[[], None]) -> Starlette:
    """The application of a node. While it lives, the queue is looked after."""

    @asynccontextmanager
    async def looking_after(application: Any) -> AsyncIterator[None]:
        async with anyio.create_task_group() as group:
            group.start_soon(_again_and_again, service.queue.look, LOOK_EVERY)
            group.start_soon(_again_and_again, tidy, TIDY_EVERY)
            yield
            group.cancel_scope.cancel()

    routes = [Route("/health", _health), *pages, *NodeRoutes(service).routes()]
    application = Starlette(routes=routes, middleware=[Middleware(TokenGuard, access=service.access)], lifespan=looking_after)
    # A redirection would send the token on, in an address that whoever asked may have named.
    application.router.redirect_slashes = False
    return application


async def _again_and_again(action: Callable[[], None], seconds: float) -> None:
    while True:
        await anyio.to_thread.run_sync(action)
        await anyio.sleep(seconds)
