"""What is dear to make and is only looked at: made once for all processes of the tests."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

_SHARED = "ORTHOMILL_TESTS_SHARED"
"""names the folder that all processes of the tests see; the first of them sets it and removes the folder at its end"""


def shared_folder() -> Path | None:
    """A new folder for this process and those that it starts; None where one was made already."""
    if _SHARED in os.environ:
        return None
    os.environ[_SHARED] = tempfile.mkdtemp(prefix="orthomill-tests-")
    return Path(os.environ[_SHARED])


def made_once(name: str, make: Callable[[Path], None]) -> Path:
    """The folder `name`, filled by the first who asks; others wait until it is whole. What a failed `make` left is made again."""
    shared = Path(os.environ[_SHARED])
    place = shared / name
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / f"{name}.whole").exists():
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            make(place)
            (shared / f"{name}.whole").touch()
    return place
