"""Names of files and folders in a run's folder, for whatever a photograph is called.

Items, rasters and tables are named after photographs, and a photograph may have any name that a file system allows. Two different
names never give the same file: another job's record or raster would pass for one's own.
"""

import hashlib
import os
from functools import lru_cache
from pathlib import Path
from urllib.parse import quote

from orthomill.schemas.errors import on_one_line

LONGEST = 170
"""Characters of a name here. File systems allow 255 bytes, of which endings and temporary names take a part, and a pair of
photographs has the names of both."""
_HEAD = 140
_PLAIN = "+,=@()[]"
"""Kept beside letters of ASCII, digits and `_.-`."""
_RESERVED = ("zarr.json",)
"""The name of zarr's own files."""


def file_name(name: str) -> str:
    """`name` as one component of a path; injective: spaces become `~`, all else that is not plain its bytes as `%C3%A4`."""
    encoded = quote(name, safe=_PLAIN, errors="surrogatepass").replace("~", "%7E").replace("%20", "~")
    if len(encoded) > LONGEST:
        # "%~" occurs in no other name: after a per cent sign come hexadecimal digits.
        return _plain_start(f"{encoded[:_HEAD]}%~{hashlib.sha256(encoded.encode()).hexdigest()[:20]}")
    return _plain_start(encoded)


def _plain_start(encoded: str) -> str:
    """Names that begin with a dot are hidden or lead upwards, and zarr reserves those that begin with two underscores."""
    if encoded.startswith((".", "__")) or encoded in _RESERVED:
        return f"%{ord(encoded[0]):02X}{encoded[1:]}"
    return encoded


@lru_cache(maxsize=4096)
def path_of(name: str, suffix: str = "") -> Path:
    """A name with slashes as a relative path, each of its parts as a `file_name`; the suffix stays as it is."""
    *folders, leaf = name.removesuffix(suffix).split("/")
    return Path(*map(file_name, folders), file_name(leaf) + suffix)


def shown(path: Path) -> str:
    """A path as the user knows it: relative to the current folder if it is inside it; on one line, whatever its name holds."""
    absolute = Path(os.path.abspath(path))
    inside = absolute.relative_to(Path.cwd()) if absolute.is_relative_to(Path.cwd()) else absolute
    return on_one_line(inside.as_posix())
