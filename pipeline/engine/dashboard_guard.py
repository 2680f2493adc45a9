"""Keeps the pages of Dask's dashboard for the user who started the run.

The dashboard listens on 127.0.0.1, which everybody on the machine can reach, and shows names, code and memory of the run. Its pages
stand under a secret first part of the path. Dask itself would tell it to anybody: it redirects `/` there, and lists all paths.
"""

import secrets
from typing import Any

from tornado.httputil import HTTPMessageDelegate, HTTPServerRequest
from tornado.routing import Router
from tornado.web import Application, ErrorHandler


def new_secret() -> str:
    """A first part of the path that cannot be guessed: 128 bits."""
    return secrets.token_urlsafe(16)


class Guard(Router):
    """Passes requests on to an application if their path begins with the secret; everything else does not exist."""

    def __init__(self, application: Application, secret: str) -> None:
        self._application, self._start = application, f"/{secret}/".encode()

    def find_handler(self, request: HTTPServerRequest, **more: Any) -> HTTPMessageDelegate:
        asked = (request.path or "").encode()[: len(self._start)]
        # Compared in constant time: the time of an answer must not tell how many characters of a guess were right.
        if secrets.compare_digest(asked, self._start):
            return self._application.find_handler(request, **more)
        return self._application.get_handler_delegate(request, ErrorHandler, {"status_code": 404})
