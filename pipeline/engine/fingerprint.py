"""What a job's result depends on, as short digests: its settings, its code, and its inputs.

Code is read as syntax, without comments and docstrings, through all project modules that the function's module imports, so that
a better comment does not cost a run. Files count by content. Everything else counts by the fingerprint of the job that made it.
"""

import ast
import hashlib
import importlib.util
import json
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

PACKAGE = "orthomill"
_PARTS = ("", ".schemas", ".tasks", ".pipeline", ".kernels")
LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "rasterio")


def digest(*parts: str) -> str:
    """A short, stable name of some text."""
    # Separated by zero bytes, which no part contains: ("ab", "c") and ("a", "bc") must differ. 80 bits are ample for 10^6 jobs.
    return hashlib.sha256("\0".join(parts).encode(errors="surrogatepass")).hexdigest()[:20]


def of_value(value: Any) -> str:
    """Digest of settings and parameters. Raises TypeError for what has no stable text (sets, open files, ...)."""
    return digest(json.dumps(_plain(value), sort_keys=True))


def _plain(value: Any) -> Any:
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
        return [type(value).__name__, {f.name: _plain(getattr(value, f.name)) for f in fields(value)}]
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if value is None or isinstance(value, str | int | float | bool):
        return value
    raise TypeError(
        f"a parameter of type {type(value).__name__} has no fingerprint; pass numbers, text, tuples, settings or frozen values"
    )


@cache
def of_code(function: Callable[..., Any]) -> str:
    """Digest of a function's module and of every project module it imports, and of the libraries it computes with."""
    # Whole modules rather than the functions called: what a function reaches is undecidable, what its module imports is not.
    modules: dict[str, str] = {}
    _collect(function.__module__, modules)
    return digest(function.__qualname__, *_libraries(), *(modules[name] for name in sorted(modules)))


@cache
def of_modules(*names: str) -> str:
    """Digest of project modules and of every project module they import, without importing them."""
    modules: dict[str, str] = {}
    for name in names:
        _collect(name, modules)
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
    tree = ast.parse(Path(spec.origin).read_text())
    imported = []
    for node in _statements(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            imported.extend([node.module, *_submodules(node.module, node)])
        elif isinstance(node, ast.Import):
            imported.extend(alias.name for alias in node.names)
        # The digest is of the syntax tree without docstrings: editing prose must not run a project again.
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef):
            node.body = [part for part in node.body if not _is_docstring(part)] or [ast.Pass()]
    return digest(ast.dump(tree)), tuple(name for name in imported if name.split(".")[0] == PACKAGE)


def _submodules(package: str, node: ast.ImportFrom) -> list[str]:
    """Modules among the names that are imported from a package: `from orthomill.tasks.photos import exif`."""
    spec = importlib.util.find_spec(package) if package.split(".")[0] == PACKAGE else None
    if spec is None or spec.submodule_search_locations is None:
        return []
    folders = [Path(place) for place in spec.submodule_search_locations]
    return [f"{package}.{alias.name}" for alias in node.names if any((f / f"{alias.name}.py").exists() for f in folders)]


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """All statements, at any depth: imports, functions and classes are among them, and expressions need not be visited."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting.extend(getattr(node, block, ()))


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def of_file(path: Path) -> str:
    """Digest of a file's content. Raises OSError."""
    # Photographs are read by many jobs; size and time of change identify the content within one run, never between runs.
    state = path.stat()
    return _of_content(path, state.st_size, state.st_mtime_ns)


@cache
def _of_content(path: Path, size: int, modified: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()[:20]
