"""Where compiled kernels are kept: one folder for each state of a kernel's file and of what that file imports.

numba reuses a compiled kernel as long as its own file is unchanged, but kernels are compiled together with those that they call,
which may be in other files: after an update outdated machine code would run. With a folder named by the digest of the file and of
all that it imports, directly or indirectly, it cannot; and a change elsewhere costs no compilation.
"""

import contextlib
import functools
import hashlib
import os
import re
import shutil
import time
from pathlib import Path

_ROOT = (Path(__file__).resolve().parents[1] / "tasks").resolve().parent
"""holds `tasks` and `schemas`: the checkout, or the installed package"""
_KEPT_DAYS = 7
_IMPORT = re.compile(r"^\s*from orthomill\.([\w.]+) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def kernel_folder(root: Path = _ROOT) -> Path:
    """Where kernels are kept: the user's choice (NUMBA_CACHE_DIR), below a checkout, or in the user's cache."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    return cache_folder(root) / "kernels"


def cache_folder(root: Path = _ROOT) -> Path:
    """Where is kept what can be made again at any time: below a checkout, or in the user's cache."""
    if (root / "pyproject.toml").exists():
        return root / ".cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "orthomill"


def sources_digest(path: Path, root: Path = _ROOT) -> str:
    """16 hexadecimal digits that change with the name or the text of a file, or of any that it imports from `root`.

    `root` holds the folders `tasks` and `schemas`.
    """
    # The transitive closure of imports: a constant in a plain module can be compiled into a kernel.
    waiting, found = [path], dict[Path, str]()
    while waiting:
        file = waiting.pop()
        if file not in found:
            found[file], imported = _read(file, root)
            waiting.extend(imported)
    digest = hashlib.sha256()
    for file in sorted(found):
        name = file.relative_to(root).as_posix() if file.is_relative_to(root) else file.name
        digest.update(f"{name}\0{found[file]}\0".encode())
    return digest.hexdigest()[:16]


@functools.cache
def _read(path: Path, root: Path) -> tuple[str, tuple[Path, ...]]:
    """The digest of a file, and the files that it imports. Read once: a process runs what it has loaded."""
    text = path.read_text(encoding="utf-8")
    files: list[Path] = []
    for module, names in _IMPORT.findall(text):
        place = root.joinpath(*module.split("."))
        # An import may name a module or something inside it.
        files.append(place.with_name(f"{place.name}.py"))
        files += [place / f"{name}.py" for name in re.findall(r"\w+", names)]
    return hashlib.sha256(text.encode()).hexdigest(), tuple(file for file in files if file.is_file())


def folder_of(path: Path, root: Path = _ROOT) -> Path:
    """The folder for the kernels of a file in its present state; not made here."""
    path = path.resolve()
    name = ".".join(path.relative_to(root).with_suffix("").parts) if path.is_relative_to(root) else path.stem
    return kernel_folder(root) / f"{name}-{sources_digest(path, root)}"


def kernels_are_kept(root: Path = _ROOT) -> bool:
    """Whether any kernel of the present sources is kept."""
    for folder in sorted(kernel_folder(root).glob("tasks.*")):
        name, _, _ = folder.name.rpartition("-")
        path = root.joinpath(*name.split(".")).with_suffix(".py")
        if path.is_file() and folder == folder_of(path, root) and next(folder.glob("*.nbc"), None):
            return True
    return False


def mark_used(folder: Path) -> None:
    """Keep a folder for another week."""
    with contextlib.suppress(OSError):
        os.utime(folder)


def tidy(root: Path = _ROOT) -> None:
    """Remove folders that nobody has used for a week: those of sources that have changed since."""
    with contextlib.suppress(OSError):  # another process may be tidying up as well
        for folder in kernel_folder(root).glob("*-????????????????"):
            if time.time() - folder.stat().st_mtime > _KEPT_DAYS * 86400:
                shutil.rmtree(folder, ignore_errors=True)
