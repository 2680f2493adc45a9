"""A small server of this process for pages of this machine: the map of a run whose scheduler lives elsewhere, the page of marks."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.web import Application, RequestHandler

from orthomill.pipeline.engine.dashboard_guard import Guard, new_secret
from orthomill.schemas.errors import ResourceError

Routes = list[tuple[str, type[RequestHandler], dict[str, Any]]]


@contextmanager
def served(routes: Routes, page: str = "tiles", port: int = 0) -> Iterator[str]:
    """The address of a page, under a secret first part of the path, on a `port` of 127.0.0.1 (0: a free one) until the context
    ends. Raises ResourceError for a port that is taken."""
    try:
        secret, sockets = new_secret(), bind_sockets(port, "127.0.0.1")
    except OSError as error:
        raise ResourceError(
            f"Port {port} of 127.0.0.1 cannot be had ({error.strerror}); choose another, or 0 for a free one."
        ) from error
    loops: list[IOLoop] = []
    ready = Event()

    def answer() -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        loops.append(IOLoop.current())
        server = HTTPServer(Guard(Application(routes), secret))
        server.add_sockets(sockets)
        loops[0].add_callback(ready.set)
        loops[0].start()
        server.stop()
        loops[0].close(all_fds=True)

    thread = Thread(target=answer, name=f"page {page}", daemon=True)
    thread.start()
    ready.wait(10)
    try:
        yield f"http://127.0.0.1:{sockets[0].getsockname()[1]}/{secret}/{page}"
    finally:
        loops[0].add_callback(loops[0].stop)
        thread.join(5)
