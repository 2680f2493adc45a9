"""Names of uploaded files: what a name may be, and what the file is for.

A name is a name and no path; it is written as it was sent, for control files and positions name photographs by it.
"""

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath

from orthomill.pipeline.storage.photographs.file_kinds import (
    DEVELOPED_SUFFIXES,
    FOREIGN_SUFFIXES,
    LIST_SUFFIXES,
    PHOTOGRAPH_SUFFIXES,
)
from orthomill.schemas.errors import WorkflowError

LONGEST = 200
"""bytes of a name"""
_RESERVED = frozenset({"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10))})


def checked_name(name: str | None) -> str:
    """The last part of a name as clients send it. Raises WorkflowError for one that is no file's name."""
    last = PureWindowsPath(PurePosixPath((name or "").strip()).name).name
    odd = any(ord(sign) < 32 or ord(sign) == 127 for sign in last)
    if not last or last.startswith(".") or odd or len(last.encode(errors="replace")) > LONGEST or ":" in last:
        shown = ascii((name or "")[:60])
        raise WorkflowError(
            f"{shown} is no name for an uploaded file: it needs 1 to {LONGEST} letters, without control signs and a leading dot."
        )
    if last.split(".")[0].lower() in _RESERVED:
        raise WorkflowError(f"'{last}' is a name that Windows keeps for itself; rename the file.")
    return last.encode("utf-8", errors="replace").decode()


def is_image(name: str) -> bool:
    """Whether a file is taken for a photograph by its name; masks are none."""
    path = Path(name.lower())
    return path.suffix in PHOTOGRAPH_SUFFIXES and not path.stem.endswith("_mask") and path.stem != "align"


def belongs_beside(name: str) -> bool:
    """Whether a file belongs beside photographs: a mask, or what may hold control, positions or a camera. `init` tells which of
    it is not read."""
    path = Path(name.lower())
    mask = path.suffix in DEVELOPED_SUFFIXES and path.stem.endswith("_mask")
    return mask or (path.suffix in LIST_SUFFIXES | FOREIGN_SUFFIXES and path.name != "image_groups.txt")


def is_archive(name: str) -> bool:
    """Whether a file holds photographs packed together."""
    return name.lower().endswith(".zip") and name.lower() != "seed.zip"


@dataclass
class NamesTaken:
    """Names for files that come with paths, from an archive or a store: cameras number their files in each folder anew, so the
    folder becomes a part of the name where two would be the same."""

    source: str
    _taken: set[str] = field(default_factory=set)

    def take(self, parts: list[str]) -> str:
        """The name of a file by its path. Raises WorkflowError for one that would be there twice."""
        name = checked_name(parts[-1])
        if name.lower() in self._taken and len(parts) > 1:
            name = checked_name(f"{parts[-2]}_{name}")
        if name.lower() in self._taken:
            raise WorkflowError(f"{self.source} holds {name!a} twice; give the photographs names of their own.")
        self._taken.add(name.lower())
        return name


def unused_sentence(name: str) -> str:
    """Why a file of the upload is not used."""
    lower = name.lower()
    if lower == "image_groups.txt":
        why = "blocks are not split by it; tiles bound the memory instead"
    elif lower.startswith("align."):
        why = "results are not aligned to an earlier surface; give control points"
    elif lower == "seed.zip":
        why = "a project of another engine is not continued"
    else:
        why = "it is neither a photograph nor a list"
    return f"Not used: {name}: {why}."
