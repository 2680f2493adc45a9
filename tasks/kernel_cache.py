"""The cache of compiled kernels: a folder named by the digest of the sources that they are compiled from.

numba reuses a compiled kernel as long as its own file is unchanged, but kernels are compiled together with those that they call,
which may be in other files: after an update outdated machine code would run. With one folder per state of the sources it cannot.
Sources are the modules that use numba and those that they import, directly or indirectly; a change elsewhere costs no compilation.
"""

import contextlib
import hashlib
import os
import re
import shutil
import sys
import time
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"
_KEPT_DAYS = 7
_IMPORT = re.compile(r"^\s*from orthomill\.([\w.]+) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def sources_digest(root: Path) -> str:
    """16 hexadecimal digits that change with the name or the text of any module under `root` that kernels are compiled from.

    `root` holds the folders `tasks` and `schemas`.
    """
    texts = {path: path.read_text() for folder in ("schemas", "tasks") for path in sorted((root / folder).rglob("*.py"))}
    # The transitive closure of imports: a constant in a plain module can be compiled into a kernel.
    waiting = [path for path, text in texts.items() if re.search(r"^\s*(from|import) numba", text, re.MULTILINE)]
    found: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting.extend(other for other in _imported(root, texts[path]) if other in texts)
    digest = hashlib.sha256()
    for path in sorted(found):
        digest.update(f"{path.relative_to(root).as_posix()}\0{texts[path]}\0".encode())
    return digest.hexdigest()[:16]


def _imported(root: Path, text: str) -> list[Path]:
    """Files that a module may import names from: the module itself, or modules of a package that are imported by name."""
    files = []
    for module, names in _IMPORT.findall(text):
        place = root.joinpath(*module.split("."))
        # An import may name a module or something inside it; what does not exist is ignored by the caller.
        files.append(place.with_name(f"{place.name}.py"))
        files += [place / f"{name}.py" for name in re.findall(r"\w+", names)]
    return files


def kernel_folder(root: Path) -> Path:
    """Where kernels are cached: below a checkout, or in the user's cache where the package is installed."""
    if (root / "pyproject.toml").exists():
        return root / ".cache" / "kernels"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "orthomill" / "kernels"


def use_kernel_cache(root: Path, kept: Path) -> None:
    """Let numba cache its kernels in a folder of `kept`, and remove folders of sources that changed long ago.

    To be called before kernels are defined. Does nothing where the user has chosen a folder, or where `kept` cannot be written.
    """
    if os.environ.get(_VARIABLE):
        return
    folder = kept / sources_digest(root)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    os.environ[_VARIABLE] = str(folder)
    if numba := sys.modules.get("numba"):
        # It has read its environment, and would keep kernels beside their sources, where outdated ones are not noticed.
        numba.config.CACHE_DIR = str(folder)
    with contextlib.suppress(OSError):  # another process may be tidying up as well
        for other in kept.iterdir():
            if other != folder and time.time() - other.stat().st_mtime > _KEPT_DAYS * 86400:
                shutil.rmtree(other, ignore_errors=True)
