"""What a module says and what it imports, without comments and docstrings; kept on disk by the content of its file.

To parse all modules of the program takes as long as all else that a second run of a finished project does. What is kept are digests
and names, as JSON, in the folder where compiled kernels are kept: it may be removed at any time.
"""

import ast
import contextlib
import hashlib
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from pydantic import TypeAdapter, ValidationError

_PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"
"""the same file has another syntax tree by another version"""


class ModuleSyntax(NamedTuple):
    """`source`: digest of the file as it is, by which it is found again; `tree`: of its statements without docstrings; `imports`:
    modules, each with the names that are taken from it (none of `import module`)."""

    source: str
    tree: str
    imports: tuple[tuple[str, tuple[str, ...]], ...]


_FILE = TypeAdapter(dict[str, ModuleSyntax])


class SyntaxFile:
    """The syntax of modules by their names, read from a file when the first one is asked for."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._modules: dict[str, ModuleSyntax] | None = None
        self._new = False

    def of(self, module: str, source: Path) -> ModuleSyntax:
        """The syntax of a module, parsed where its file has changed. Raises OSError, SyntaxError."""
        content = source.read_bytes()
        digest = hashlib.sha256(_PYTHON.encode() + b"\0" + content).hexdigest()
        if self._modules is None:
            self._modules = self._read()
        kept = self._modules.get(module)
        if kept is None or kept.source != digest:
            kept = self._modules[module] = ModuleSyntax(digest, *parsed(content.decode("utf-8")))
            self._new = True
        return kept

    def save(self) -> None:
        """Keep what was parsed since the last time; where the folder cannot be written it is parsed again next time."""
        if not self._new or self._modules is None:
            return
        self._new = False
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            # Runs of other projects read and write it at the same time: each finds a whole file, of the one or of the other.
            handle, name = tempfile.mkstemp(dir=self._path.parent, prefix=f".{self._path.name}-")
            with os.fdopen(handle, "wb") as file:
                file.write(_FILE.dump_json(self._modules))
            Path(name).replace(self._path)

    def _read(self) -> dict[str, ModuleSyntax]:
        try:
            return _FILE.validate_json(self._path.read_bytes())
        except (OSError, ValidationError):
            return {}


def parsed(text: str) -> tuple[str, tuple[tuple[str, tuple[str, ...]], ...]]:
    """The digest of the statements of a module without docstrings, and its imports: see `ModuleSyntax`. Raises SyntaxError."""
    tree = ast.parse(text)
    imports: list[tuple[str, tuple[str, ...]]] = []
    for node in _statements(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            imports.append((node.module, tuple(alias.name for alias in node.names)))
        elif isinstance(node, ast.Import):
            imports.extend((alias.name, ()) for alias in node.names)
        # The digest is of the syntax tree without docstrings: editing prose must not run a project again.
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef):
            node.body = [part for part in node.body if not _is_docstring(part)] or [ast.Pass()]
    return hashlib.sha256(ast.dump(tree).encode(errors="surrogatepass")).hexdigest()[:20], tuple(imports)


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
