"""Makes the shared scenes and stages importable by their names, in this process and in the worker processes that tests start."""

import atexit
import gc
import os
import shutil
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from orthomill.pipeline.engine.one_thread import one_thread_from_here

one_thread_from_here()  # as in the command, before any numerical library is loaded

# What Python compiles is kept, also where a container says to keep nothing: each process would compile 500 files of tests again.
# It is kept beside the sources, where `pip` has put that of the libraries; in a folder of ours these would be compiled once more.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

SUPPORT = [
    str(Path(__file__).parent / "support" / room) for room in ("engine", "scenes", "flights", "checking", "boards", "serving")
]
sys.path[:0] = SUPPORT
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [*SUPPORT, os.environ.get("PYTHONPATH", "")]))

from made_once import shared_folder  # noqa: E402  found by the lines above
from measured_tests import SLOW, TestTimes, name_of  # noqa: E402

if folder := shared_folder():
    atexit.register(shutil.rmtree, folder, ignore_errors=True)

# Machines are busy, so no example has a deadline. CI draws the same examples each time: what it finds, everybody finds again.
settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")


def pytest_configure(config):
    if path := os.environ.get("ORTHOMILL_TEST_TIMES"):
        config.pluginmanager.register(TestTimes(Path(path)))


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Modules and tests are a million objects that stay: to look for garbage among them is a third of what finding them takes."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Several processes take whole files, those with slow tests first: one that begins last keeps everybody waiting."""
    measured = set(SLOW.read_text().split())
    for item in items:
        if name_of(item.nodeid) in measured:
            item.add_marker("slow")
    if hasattr(config, "workerinput"):
        slow = {item.path for item in items if item.get_closest_marker("slow")}
        items.sort(key=lambda item: item.path not in slow)
