"""A small server of this process for the map of a run whose scheduler lives elsewhere: nothing of orthomill is sent there."""

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

Routes = list[tuple[str, type[RequestHandler], dict[str, Any]]]


@contextmanager
def served(routes: Routes) -> Iterator[str]:
    """The address of the map, under a secret first part of the path, on a free port of 127.0.0.1 until the context ends."""
    secret, sockets = new_secret(), bind_sockets(0, "127.0.0.1")
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

    thread = Thread(target=answer, name="map of tiles", daemon=True)
    thread.start()
    ready.wait(10)
    try:
        yield f"http://127.0.0.1:{sockets[0].getsockname()[1]}/{secret}/tiles"
    finally:
        loops[0].add_callback(loops[0].stop)
        thread.join(5)
