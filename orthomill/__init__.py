"""orthomill: from overlapping photographs to a checked surface model and a blended true orthoimage.

For notebooks and programs. `open` gives a finished project: its block, rasters, points and figures. `calibrate`, `orient`,
`match`, `match_surface` and `check` call the methods of the stages without a project.

    >>> import orthomill
    >>> volos = orthomill.open("runs/volos")
    >>> volos.block.sigma0_px, volos.raster("densification/height").mean().compute()

Everything is loaded when it is first asked for, so that importing the package costs nothing.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from orthomill.board_calibration import BoardCalibration as BoardCalibration
    from orthomill.board_calibration import calibrate as calibrate
    from orthomill.finished_project import FinishedProject as FinishedProject
    from orthomill.finished_project import open as open
    from orthomill.photograph_matching import match as match
    from orthomill.photograph_matching import match_surface as match_surface
    from orthomill.photograph_matching import read_photograph as read_photograph
    from orthomill.photograph_orientation import OrientedBlock as OrientedBlock
    from orthomill.photograph_orientation import orient as orient
    from orthomill.surface_check import SurfaceCheck as SurfaceCheck
    from orthomill.surface_check import check as check

_PLACES = {
    "open": ("finished_project", "open"),
    "FinishedProject": ("finished_project", "FinishedProject"),
    "calibrate": ("board_calibration", "calibrate"),
    "BoardCalibration": ("board_calibration", "BoardCalibration"),
    "orient": ("photograph_orientation", "orient"),
    "OrientedBlock": ("photograph_orientation", "OrientedBlock"),
    "match": ("photograph_matching", "match"),
    "match_surface": ("photograph_matching", "match_surface"),
    "read_photograph": ("photograph_matching", "read_photograph"),
    "check": ("surface_check", "check"),
    "SurfaceCheck": ("surface_check", "SurfaceCheck"),
}

__version__ = "0.2.0"
"""the only place of the version: the distribution (pyproject.toml), the command and the records of runs read it here"""

__all__ = [*_PLACES]

if (Path(__file__).parent / "tasks").is_file():  # what git writes where it may not make links
    raise ImportError(
        "orthomill/tasks, schemas and pipeline are links in git, and this checkout has files of text in their place: "
        "type 'git config core.symlinks true', then 'git checkout -- orthomill', on a file system that knows links"
    )


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"orthomill has no '{name}'; it has {', '.join(__all__)}")
    module, attribute = _PLACES[name]
    return getattr(import_module(f"orthomill.{module}"), attribute)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
