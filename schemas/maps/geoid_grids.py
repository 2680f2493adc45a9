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
_BALLPARK = "ballpark vertical"
"""how PROJ calls an operation that changes no height"""
_CDN = "https://cdn.proj.org"


@cache
def with_grids_of_the_system() -> None:
    """Lets PROJ look for grids in the folders of the system's packages, too."""
    for folder in SYSTEM:
        if Path(folder).is_dir():
            datadir.append_data_dir(folder)


def leaves_heights(group: Any) -> bool:
    """Whether the best operation that PROJ has between two vertical systems (TransformerGroup) leaves heights as they are: a grid
    is missing, or it knows none, as for N2000 in Finland."""
    return not group.transformers or not group.best_available or _BALLPARK in group.transformers[0].description


def missing_grids(operations: Iterable[Any]) -> tuple[str, ...]:
    """Names of the grids that the best of PROJ's unavailable `operations` needs and does not find: the first of those that need
    fewest, and of which PROJ has them all to offer."""
    found = [tuple(grid for grid in operation.grids if not grid.available) for operation in operations]
    offered = [grids for grids in found if grids and all(grid.url for grid in grids)] or [grids for grids in found if grids]
    return tuple(grid.short_name for grid in min(offered, key=len, default=()))


def how_to_get(grids: tuple[str, ...]) -> str:
    """What to do about missing grids, as the end of a sentence that begins with a verb."""
    if not grids:
        return "no grid for it is published; give heights in the project's own system"
    commands = " and ".join(f"python -m pyproj sync --file {name}" for name in grids)
    return (
        f"get it with: {commands} (from {', '.join(f'{_CDN}/{name}' for name in grids)}); without network copy that file to "
        f"{datadir.get_user_data_dir()}; Debian's package proj-data has EGM96"
    )
