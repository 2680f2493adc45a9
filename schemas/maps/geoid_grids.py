"""The grids of geoids that heights need: where PROJ may find them on this machine, and how to get one that it lacks.

The wheels of pyproj come without any grid. Those of the system's own PROJ serve as well; its folder is added behind that of the
wheel, so that the wheel's newer proj.db remains the one that is used.
"""

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from pyproj import datadir

SYSTEM = ("/usr/share/proj", "/usr/local/share/proj", "/opt/homebrew/share/proj")
"""where packages of PROJ put their grids: Debian's proj-data, Fedora's proj-data-xx, Homebrew's proj"""
_CDN = "https://cdn.proj.org"


@cache
def with_grids_of_the_system() -> None:
    """Lets PROJ look for grids in the folders of the system's packages, too."""
    for folder in SYSTEM:
        if Path(folder).is_dir():
            datadir.append_data_dir(folder)


def missing_grids(operations: Iterable[Any]) -> tuple[str, ...]:
    """Names of the grids that PROJ's unavailable `operations` need and do not find."""
    found = {grid.short_name for operation in operations for grid in operation.grids if not grid.available}
    return tuple(sorted(found))


def how_to_get(grids: tuple[str, ...]) -> str:
    """What to do about missing grids, as the end of a sentence that begins with a verb."""
    if not grids:
        return "no grid for it is published; give heights in the project's own system"
    name = grids[0]
    return (
        f"get it with: python -m pyproj sync --file {name} (from {_CDN}/{name}); without network copy that file to "
        f"{datadir.get_user_data_dir()}; Debian's package proj-data has EGM96"
    )
