"""Examines a machine before it is put to work: versions, cores, memory, disk, drivers, and what the file system of the runs can do.

Every finding is one row: what was examined, what was found, whether it suffices, and what to do where it does not. Nothing is left
behind, and nothing outside the given folder is written.
"""

import fcntl
import multiprocessing
import os
import shutil
import socket
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import psutil
import rasterio
from pyproj import CRS
from pyproj.exceptions import CRSError

from orthomill.kernels.kernel_cache import kernel_folder
from orthomill.schemas.memory import GIB

LIBRARIES = (
    ("numpy", 1),
    ("scipy", 1),
    ("numba", 0),
    ("opencv-python-headless", 5),  # 4.x rounds remapped positions to 1/32 px
    ("rasterio", 1),
    ("zarr", 3),  # the store is zarr format 3, which version 2 cannot read
    ("dask", 2024),
    ("distributed", 2024),
    ("pydantic", 2),
    ("pyproj", 3),
    ("pyarrow", 10),
    ("laspy", 2),
    ("lazrs", 0),
    ("jinja2", 3),
    ("matplotlib", 3),
)
"""(distribution, least major version)"""
DRIVERS = ("GTiff", "COG", "JPEG", "PNG")
DASHBOARD_PORT = 8787
LEAST_MEMORY, LEAST_DISK = 2 * GIB, 5 * GIB
"""One worker with the default --memory of 1.5 GiB and the parent process; rasters and products of a small project."""


@dataclass(frozen=True)
class Finding:
    """One row of the examination; `advice` is empty when there is nothing to do."""

    name: str
    value: str
    ok: bool
    advice: str = ""


def doctor(folder: Path) -> list[Finding]:
    """Examine this machine for projects whose runs live under `folder`."""
    return [
        _python(),
        *(_library(name, least) for name, least in LIBRARIES),
        _gdal(),
        *(_driver(name) for name in DRIVERS),
        _projections(),
        _cores(),
        _memory(),
        *_run_folder(Path(folder)),
        _kernel_cache(),
        _port(DASHBOARD_PORT),
    ]


def _judged(name: str, value: str, ok: bool, advice: str) -> Finding:
    return Finding(name, value, ok, "" if ok else advice)


# --- software ----------------------------------------------------------------------------------------------------------------


def _python() -> Finding:
    found = ".".join(str(part) for part in sys.version_info[:3])
    return _judged("Python", found, sys.version_info >= (3, 11), "install Python 3.11 or newer and run `make setup` with it")


def _library(name: str, least: int) -> Finding:
    try:
        found = version(name)
    except PackageNotFoundError:
        return Finding(name, "missing", False, "run `make setup`")
    return _judged(name, found, int(found.split(".")[0]) >= least, f"version {least} or newer is needed; run `make setup`")


def _gdal() -> Finding:
    found = rasterio.__gdal_version__
    # Statistics of a COG, which the report of the products relies on, came with 3.8.
    recent = tuple(int(part) for part in found.split(".")[:2]) >= (3, 8)
    return _judged("GDAL", found, recent, "3.8 or newer is needed; run `make setup`")


def _driver(name: str) -> Finding:
    with rasterio.Env() as environment:
        there = name in environment.drivers()
    advice = "use the rasterio wheel from the package index, which includes it"
    return _judged(f"GDAL driver {name}", "present" if there else "missing", there, advice)


def _projections() -> Finding:
    # Another installation's PROJ_DATA in the environment is the usual reason why a known code is not found.
    try:
        return Finding("PROJ database", CRS.from_epsg(2100).name, True)
    except CRSError:
        advice = "unset PROJ_DATA and PROJ_LIB, or set them to the database of pyproj"
        return Finding("PROJ database", "missing", False, advice)


# --- the machine -------------------------------------------------------------------------------------------------------------


def _cores() -> Finding:
    # The affinity, where there is one, is what a container or a batch system grants; the machine may have more cores.
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else multiprocessing.cpu_count()
    return Finding("processor cores", str(usable), True, "one core only: tiles run one after another" if usable == 1 else "")


def _memory() -> Finding:
    free, total = psutil.virtual_memory().available, psutil.virtual_memory().total
    advice = "close other programs, or choose a smaller tile in the workflow and fewer workers"
    return _judged("memory", f"{free / GIB:.1f} GiB free of {total / GIB:.1f}", free >= LEAST_MEMORY, advice)


def _port(port: int) -> Finding:
    with socket.socket() as probe:
        # Without this a port closed a minute ago counts as taken (TIME_WAIT), although the dashboard could have it.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return Finding(f"dashboard port {port}", "taken", True, "the dashboard takes the next free port and prints it")
    return Finding(f"dashboard port {port}", "free", True)


def _kernel_cache() -> Finding:
    """Where numba keeps compiled kernels: without it every worker compiles all of them again, which takes minutes."""
    folder = kernel_folder()
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    advice = "set NUMBA_CACHE_DIR to a folder that can be written, so that kernels are compiled once"
    return _judged("kernel cache", str(folder), _can(existing, _write), advice)


# --- the folder of the runs --------------------------------------------------------------------------------------------------


def _run_folder(folder: Path) -> list[Finding]:
    # `runs` is often a link to a larger disk: what counts is the file system that it leads to.
    place = folder / "runs" if (folder / "runs").is_dir() else folder
    if not _can(place, _write):
        advice = "make it writable, or work in another folder"
        return [Finding("run folder", f"{place} cannot be written", False, advice)]
    free = shutil.disk_usage(place).free
    return [
        Finding("run folder", str(place), True),
        _judged("free disk", f"{free / GIB:.1f} GiB", free >= LEAST_DISK, "make room: a small project takes several GiB"),
        # Network file systems may grant every lock, or replace a file in two steps: both are tried, not looked up.
        _capability(place, "file locks", _lock, "two runs of one project could disturb each other: work on a local disk"),
        _capability(place, "atomic renaming", _rename, "an interrupted write could leave half a file: work on a local disk"),
    ]


def _capability(place: Path, name: str, trial: Callable[[Path], None], advice: str) -> Finding:
    works = _can(place, trial)
    return _judged(name, "works" if works else "does not work", works, advice)


def _can(place: Path, trial: Callable[[Path], None]) -> bool:
    """Whether a trial in a temporary folder inside `place` succeeds."""
    try:
        with tempfile.TemporaryDirectory(dir=place, prefix=".orthomill-doctor-") as scratch:
            trial(Path(scratch))
    except OSError:
        return False
    return True


def _write(scratch: Path) -> None:
    (scratch / "file").write_bytes(b"x" * 4096)


def _lock(scratch: Path) -> None:
    """A lock must be granted once and refused to a second opening of the same file."""
    with (scratch / "lock").open("a") as first, (scratch / "lock").open("a") as second:
        fcntl.flock(first, fcntl.LOCK_EX | fcntl.LOCK_NB)
        try:
            fcntl.flock(second, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return
        raise OSError("a second lock was granted")


def _rename(scratch: Path) -> None:
    (scratch / "old").write_text("old")
    (scratch / "new").write_text("new")
    os.replace(scratch / "new", scratch / "old")
    if (scratch / "old").read_text() != "new" or (scratch / "new").exists():
        raise OSError("the file was not replaced")
