"""What a job's result depends on, as short digests: its settings, its code, and its inputs.

Code is read as syntax, without comments and docstrings, through all project modules that the function's module imports, so that
a better comment does not cost a run. Files count by content. Everything else counts by the fingerprint of the job that made it.
"""

import hashlib
import importlib.util
import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from orthomill.kernels.kernel_cache import cache_folder
from orthomill.pipeline.engine.module_syntax import SyntaxFile
from orthomill.schemas.job import Raster, Region

PACKAGE = "orthomill"
_PARTS = ("", ".schemas", ".tasks", ".pipeline", ".kernels")
LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "rasterio")


def digest(*parts: str) -> str:
    """A short, stable name of some text."""
    # Separated by zero bytes, which no part contains: ("ab", "c") and ("a", "bc") must differ. 80 bits are ample for 10^6 jobs.
    return hashlib.sha256("\0".join(parts).encode(errors="surrogatepass")).hexdigest()[:20]


def of_value(value: Any) -> str:
    """Digest of settings and parameters. Raises TypeError for what has no stable text (sets, open files, ...)."""
    return digest(_AS_TEXT(_plain(value)))


_AS_TEXT = json.JSONEncoder(sort_keys=True).encode


def region_text(region: Region) -> str:
    """A region as text: what `repr` gives, which takes four times as long where it is one of a raster."""
    if type(region) is not Raster:
        return repr(region)
    at = region.window
    return f"Raster(name={region.name!r}, window=Window(row={at.row!r}, col={at.col!r}, height={at.height!r}, width={at.width!r}))"


_PLAIN = (int, float, str, bool, type(None))


def _plain(value: Any) -> Any:
    # Most values of most jobs; exactly these types, for numpy has numbers that are floats as well.
    if type(value) in _PLAIN:
        return value
    # The name of the type is part of the text: two kinds of settings with equal fields are different settings.
    if isinstance(value, BaseModel):
        return [type(value).__name__, value.model_dump(mode="json")]
    if isinstance(value, Enum):
        return [type(value).__name__, value.value]
    if isinstance(value, np.ndarray):
        return ["array", value.shape, str(value.dtype), hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, type):
        return f"{value.__module__}.{value.__qualname__}"
    if is_dataclass(value):
        return [type(value).__name__, {name: _plain(getattr(value, name)) for name in _fields(value.__class__)}]
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, str | int | float):
        return value
    raise TypeError(
        f"a parameter of type {type(value).__name__} has no fingerprint; pass numbers, text, tuples, settings or frozen values"
    )


@cache
def _fields(kind: Any) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


@cache
def of_code(function: Callable[..., Any]) -> str:
    """Digest of a function's module and of every project module it imports, and of the libraries it computes with."""
    # Whole modules rather than the functions called: what a function reaches is undecidable, what its module imports is not.
    modules: dict[str, str] = {}
    _collect(function.__module__, modules)
    _kept().save()
    return digest(function.__qualname__, *_libraries(), *(modules[name] for name in sorted(modules)))


@cache
def of_modules(*names: str) -> str:
    """Digest of project modules and of every project module they import, without importing them."""
    modules: dict[str, str] = {}
    for name in names:
        _collect(name, modules)
    _kept().save()
    return digest(*(modules[name] for name in sorted(modules)))


@cache
def of_program() -> str:
    """Digest of all modules of the program, as they are on the disk when it is first asked."""
    whole = hashlib.sha256()
    for folder in (Path(place) for name in _PARTS for place in _locations(f"{PACKAGE}{name}")):
        # Below the package itself its parts may stand as links.
        for path in sorted(folder.rglob("*.py") if folder.name != PACKAGE else folder.glob("*.py")):
            whole.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()[:20]


def _locations(package: str) -> list[str]:
    spec = importlib.util.find_spec(package)
    return list(spec.submodule_search_locations or ()) if spec else []


@cache
def _libraries() -> tuple[str, ...]:
    return tuple(f"{name} {version(name)}" for name in LIBRARIES)


def _collect(module: str, found: dict[str, str]) -> None:
    if module in found or module.split(".")[0] != PACKAGE:
        return
    text, imported = _syntax(module)
    found[module] = text
    for name in imported:
        _collect(name, found)


@cache
def _syntax(module: str) -> tuple[str, tuple[str, ...]]:
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        return "", ()
    syntax = _kept().of(module, Path(spec.origin))
    imported = (name for source, names in syntax.imports for name in (source, *_submodules(source, names)))
    return syntax.tree, tuple(name for name in imported if name.split(".")[0] == PACKAGE)


@cache
def _kept() -> SyntaxFile:
    return SyntaxFile(cache_folder() / "syntax.json")


def _submodules(package: str, names: tuple[str, ...]) -> list[str]:
    """Modules among the names that are imported from a package: `from orthomill.tasks.photos import exif`."""
    spec = importlib.util.find_spec(package) if names and package.split(".")[0] == PACKAGE else None
    if spec is None or spec.submodule_search_locations is None:
        return []
    folders = [Path(place) for place in spec.submodule_search_locations]
    return [f"{package}.{name}" for name in names if any((folder / f"{name}.py").exists() for folder in folders)]


def of_file(path: Path) -> str:
    """Digest of a file's content. Raises OSError."""
    # Photographs are read by many jobs; size and time of change identify the content within one run, never between runs.
    state = path.stat()
    return _of_content(path, state.st_size, state.st_mtime_ns)


@cache
def _of_content(path: Path, size: int, modified: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()[:20]
