"""Where compiled kernels are kept: in a folder named by the digest of all sources.

numba keeps a compiled kernel as long as its own file is unchanged, but kernels are compiled together with those that they call,
and these may lie in other files: after an update old machine code would go on to run. With a folder for each state of the sources
nothing old is found.
"""

import contextlib
import hashlib
import os
import shutil
import time
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"
_KEPT_DAYS = 7


def sources_digest(folder: Path) -> str:
    """16 hexadecimal digits that change with the name or the text of any module below `folder`."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def use_kernel_cache(sources: Path, kept: Path) -> None:
    """Let numba keep its kernels in a folder of `kept`, and remove those of sources that changed long ago.

    To be called before numba is loaded. Leaves things alone where the user has chosen a folder, or where `kept` cannot be written.
    """
    if os.environ.get(_VARIABLE):
        return
    folder = kept / sources_digest(sources)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    os.environ[_VARIABLE] = str(folder)
    with contextlib.suppress(OSError):  # another process may be tidying up as well
        for other in kept.iterdir():
            if other != folder and time.time() - other.stat().st_mtime > _KEPT_DAYS * 86400:
                shutil.rmtree(other, ignore_errors=True)
