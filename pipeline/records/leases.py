"""One run of a project at a time where machines share nothing but an object store: a lease, an object that its owner renews.

Clocks of several machines are not compared: a lease has ended when somebody has watched it for `LEASE` seconds without a
renewal, or when its process is known to have ended because it belonged to this machine.
"""

import json
import os
import secrets
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from threading import Event

from orthomill.pipeline.records.beside import going_on
from orthomill.pipeline.records.started_machine import boot
from orthomill.pipeline.storage.depots.bucket import Bucket
from orthomill.schemas.errors import ResourceError, StoreError

NAME = "lease.json"
LEASE = 60.0
"""seconds without a renewal after which a lease has ended"""
RENEWED = 10.0
"""seconds between two renewals"""


@contextmanager
def leased(bucket: Bucket, project: str) -> Iterator[None]:
    """Hold the lease of a project. Raises ResourceError while another run holds it, StoreError."""
    token = secrets.token_hex(8)
    _take(bucket, project, token)
    try:
        with going_on(partial(_renew_until, bucket, token)):
            yield
    finally:
        with suppress(StoreError):  # it ends by itself
            if _holder(_content(bucket)).get("token") == token:
                bucket.delete(NAME)


def is_leased(bucket: Bucket) -> bool:
    """Whether a run seems to hold the lease at this moment: nobody waits for a proof here."""
    return bool(content := _content(bucket)) and not _has_ended(content)


def _take(bucket: Bucket, project: str, token: str) -> None:
    deadline = time.monotonic() + LEASE
    seen = _version(bucket)
    while not (bucket.create(NAME, _lease(token, 0)) if seen is None else _take_over(bucket, token, seen, deadline)):
        now = _version(bucket)
        if now is not None and seen is not None and now != seen:
            holder = _holder(_content(bucket))
            raise ResourceError(
                f"{project} is already running ({holder.get('host', 'somewhere')}, process {holder.get('process', 'unknown')}); "
                "wait for it to end, or stop it first."
            )
        seen = now
        time.sleep(0.0 if seen is None else 1.0)


def _take_over(bucket: Bucket, token: str, seen: str | int, deadline: float) -> bool:
    """Take a lease that has ended; False while that is not certain."""
    if time.monotonic() < deadline and not _has_ended(_content(bucket)):
        return False
    return bucket.replace(NAME, _lease(token, 0), seen)


def _has_ended(content: bytes) -> bool:
    """Whether its process was of this machine and is no more."""
    holder = _holder(content)
    if holder.get("host") != socket.gethostname():
        return False
    if holder.get("boot") != boot():
        return True
    try:
        os.kill(int(holder.get("process", 0)), 0)  # no signal, but the question whether it could be sent
    except ProcessLookupError:
        return True
    except PermissionError:
        return False
    return False


def _renew_until(bucket: Bucket, token: str, ended: Event) -> None:
    count = 0
    while not ended.wait(RENEWED):
        count += 1
        with suppress(StoreError):  # while the store is away nobody else can take the lease
            if not _renewed(bucket, token, count):
                # Somebody else took it, since this process stood still for too long: two runs would write the same files.
                os.kill(os.getpid(), signal.SIGTERM)
                return


def _renewed(bucket: Bucket, token: str, count: int) -> bool:
    version = _version(bucket)
    return (
        version is not None
        and _holder(_content(bucket)).get("token") == token
        and bucket.replace(NAME, _lease(token, count), version)
    )


def _lease(token: str, count: int) -> bytes:
    holder = {"host": socket.gethostname(), "boot": boot(), "process": os.getpid(), "token": token, "renewed": count}
    return json.dumps(holder).encode()


def _holder(content: bytes) -> dict:
    try:
        return dict(json.loads(content))
    except ValueError:  # gone meanwhile, or no lease
        return {}


def _content(bucket: Bucket) -> bytes:
    try:
        return bucket.get(NAME)
    except FileNotFoundError:
        return b""


def _version(bucket: Bucket) -> str | int | None:
    state = bucket.state(NAME)
    return state.version if state else None
