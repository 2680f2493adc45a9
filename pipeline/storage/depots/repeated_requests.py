"""Requests whose answer breaks off in its middle, repeated.

The library repeats requests that are refused or not answered, and reads on in an object; an answer of another kind (a list of
objects, of those that were removed, of the parts of a file) that is cut after its first line it hands on as an error.
"""

import time
from collections.abc import Callable
from datetime import timedelta
from typing import TypeVar

PATIENCE = timedelta(minutes=5)
"""for which a request is repeated while the store does not answer"""
_FIRST_PAUSE, _LONGEST_PAUSE = 0.3, 15.0

Answer = TypeVar("Answer")


def repeated(request: Callable[[], Answer]) -> Answer:
    """What a request answers that may be made twice. Raises what the library raises where it is not the answer that broke off."""
    from obstore.exceptions import GenericError

    until, pause = time.monotonic() + PATIENCE.total_seconds(), _FIRST_PAUSE
    while True:
        try:
            return request()
        except GenericError as error:
            if "response body" not in str(error) or time.monotonic() + pause > until:
                raise
        time.sleep(pause)
        pause = min(2 * pause, _LONGEST_PAUSE)
