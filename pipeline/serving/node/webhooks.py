"""Tells those who asked that a task has ended: one POST with its info, tried again some times; redirects are not followed."""

import json
import time
import urllib.request
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any
from urllib.error import HTTPError, URLError

from orthomill.pipeline.serving.queue.task_state import TaskState

TRIES, SECONDS, PAUSE = 3, 10.0, 20.0
"""attempts, patience with each, and time between them (s)"""


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_: Any, **__: Any) -> None:
        """An address that sends on is answered with what it said."""
        return None


@dataclass
class Webhooks:
    """Calls addresses, one after the other, outside of the loop of the server."""

    told: Callable[[TaskState], dict[str, Any]]
    done: Callable[[str], None]
    pause: float = PAUSE
    _pending: set[str] = field(default_factory=set)
    _pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(2, "webhooks"))

    def notify(self, state: TaskState) -> None:
        """Tell of a task that has ended, unless that is under way."""
        if state.uuid not in self._pending:
            self._pending.add(state.uuid)
            self._pool.submit(self._call, state)

    def _call(self, state: TaskState) -> None:
        body = json.dumps(self.told(state)).encode()
        try:
            for attempt in range(TRIES):
                if attempt:
                    time.sleep(self.pause)
                if _posted(state.webhook, body):
                    break
        finally:
            self.done(state.uuid)
            self._pending.discard(state.uuid)


def _posted(address: str, body: bytes) -> bool:
    # Only http and https were taken when the task was given.
    request = urllib.request.Request(address, body, {"Content-Type": "application/json", "User-Agent": "orthomill"})  # noqa: S310
    try:
        with urllib.request.build_opener(_NoRedirects).open(request, timeout=SECONDS):
            return True
    except HTTPError as error:
        # Whoever answers has heard it, unless it asks to be told later.
        return error.code < 500
    except (URLError, OSError, ValueError):
        return False
