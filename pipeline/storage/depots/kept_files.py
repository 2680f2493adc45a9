"""The files that a job left in the depot: what they were like when it ended, and whether they still are.

A file counts as whole while its size and time of change are as recorded, which costs one question. Where the
time differs (a copy of the project, or damage), and whenever somebody asks for a thorough check, its checksum decides.
"""

from collections.abc import Iterable, Mapping
from typing import Literal

from orthomill.pipeline.storage.depots.depot import Depot, KeptFile

Defect = Literal["missing", "damaged"]
KeptFiles = Mapping[str, KeptFile]
"""by name in the run's depot"""


def keep(depot: Depot, names: Iterable[str], known: Mapping[str, KeptFile] | None = None) -> dict[str, KeptFile]:
    """What files of a run are like; those that are `known` need not be looked at. Raises OSError."""
    return {name: known[name] if known and name in known else depot.kept(name) for name in names}


def defect_of(depot: Depot, name: str, kept: KeptFile, thoroughly: bool) -> Defect | None:
    """What is wrong with a file, None when it is whole; `thoroughly`: its content is read in any case. Raises OSError."""
    try:
        state = depot.state(name)
        if state is None:
            return "missing"
        if state.size != kept.size:
            return "damaged"
        unchanged = state.changed == kept.changed and not thoroughly
        return None if unchanged or depot.kept(name).checksum == kept.checksum else "damaged"
    except FileNotFoundError:
        return "missing"


def first_defect(depot: Depot, files: KeptFiles, thoroughly: bool = False) -> tuple[str, Defect] | None:
    """The first of a job's files that is not whole, and what is wrong with it. Raises OSError."""
    for name, kept in files.items():
        if defect := defect_of(depot, name, kept, thoroughly):
            return name, defect
    return None
