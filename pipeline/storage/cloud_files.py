"""Reads point clouds (LAS, LAZ) of the user as points of known height, in metres and in the system of a project.

Points that are marked as noise or withheld are left out. The standard error of a height is an attribute of its own (extra bytes),
under one of the names that programs give it; it is in the unit of the heights.
"""

from pathlib import Path

import laspy
import numpy as np
from laspy.errors import LaspyException
from lazrs import LazrsError
from pyproj import CRS, Transformer

from orthomill.pipeline.storage.height_systems import HeightSystem, heights_in_metres, horizontal
from orthomill.pipeline.storage.point_files import is_wanted, opened_points, system_of
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.solid.cloud_points import CloudPoints

SIGMAS = ("sigma_z", "std_z", "z_std", "precision", "standard error", "sigma")
"""names of the attribute that holds the standard error of a height, the best first"""


def read_cloud(path: Path, crs: str) -> CloudPoints:
    """All points, in metres in `crs`. Raises WorkflowError for a file that cannot be read, and for heights that PROJ cannot bring
    into the vertical system of `crs` without a grid."""
    with opened_points(path) as file:
        system = system_of(file, path, crs)
        try:
            points = file.read()
        except (LaspyException, LazrsError, ValueError) as error:
            raise WorkflowError(f"{path} is damaged ({str(error).splitlines()[0]}); get it again.") from error
    points = points.points[is_wanted(points.points)]
    x, y, z = (np.asarray(points[axis], np.float64) for axis in "xyz")
    x, y = _in_plan(x, y, system, crs)
    return CloudPoints(x, y, heights_in_metres(z, x, y, system, crs, str(path)), _sigma(points) * system.unit)


def _in_plan(x: np.ndarray, y: np.ndarray, system: HeightSystem, crs: str) -> tuple[np.ndarray, np.ndarray]:
    target = horizontal(CRS.from_user_input(crs))
    return (x, y) if system.plan == target else Transformer.from_crs(system.plan, target, always_xy=True).transform(x, y)


def _sigma(points: laspy.ScaleAwarePointRecord) -> np.ndarray:
    """(N,) the stated standard errors in the unit of the file; NaN where there are none."""
    named = {name.lower().replace("_", " "): name for name in points.point_format.extra_dimension_names}
    found = next((named[name.replace("_", " ")] for name in SIGMAS if name.replace("_", " ") in named), None)
    if found is None:
        return np.full(len(points), np.nan)
    sigma = np.asarray(points[found], np.float64)
    return np.where(sigma > 0, sigma, np.nan)
