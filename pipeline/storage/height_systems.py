"""What turns the values of a height file into metres in the vertical system of a project.

Strategy: units come from the vertical axis of the file's reference system, or from the unit of its band. Where both file and
project name a vertical system, PROJ transforms between them; it is asked at a lattice of places only, because geoid and ellipsoid
change slowly. Where only one of them is named nothing can be known, and heights are taken as they are: the check finds a constant
shift.
"""

from dataclasses import dataclass

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.maps.geoid_grids import how_to_get, leaves_heights, missing_grids, with_grids_of_the_system

FEET = {"ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us-ft": 1200 / 3937, "us survey foot": 1200 / 3937, "ftus": 1200 / 3937}
"""names of units of bands -> m"""
_LATTICE = 5
"""places along a side of a window"""


@dataclass(frozen=True)
class HeightSystem:
    """The reference system of a file, its vertical part (None: unknown), and the length of its unit of height, m."""

    whole: CRS
    vertical: CRS | None
    unit: float

    @property
    def plan(self) -> CRS:
        """The system of its coordinates in plan."""
        return horizontal(self.whole)


def height_system(crs: CRS, unit: str = "") -> HeightSystem:
    """The system of a file; `unit`: what its band says of its values."""
    up = vertical(crs)
    axis = up.axis_info[-1].unit_conversion_factor if up is not None and up.axis_info else None
    return HeightSystem(crs, up, FEET.get(unit.strip().lower(), axis or 1.0))


def horizontal(crs: CRS) -> CRS:
    """The plan part of a system."""
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


def vertical(crs: CRS) -> CRS | None:
    """The system of its heights; None where it has none."""
    if crs.is_compound:
        return crs.sub_crs_list[1]
    # Ellipsoidal heights are no system of their own: they belong to the three-dimensional one.
    return crs if len(crs.axis_info) == 3 else None


def named(text: str, where: str) -> CRS:
    """The system that a user names. Raises WorkflowError."""
    try:
        return CRS.from_user_input(text)
    except CRSError:
        raise WorkflowError(
            f"{where} is to be in '{text}', which PROJ does not know; look up its code at https://epsg.io."
        ) from None


def in_metres(values: np.ndarray, x: np.ndarray, y: np.ndarray, system: HeightSystem, crs: str, where: str) -> np.ndarray:
    """Values (rows, cols) of a file at the columns `x` and the rows `y` (m in `crs`) as heights of `crs`, float32 m.

    Raises WorkflowError where the transformation needs a grid that this machine does not have.
    """
    target = CRS.from_user_input(crs)
    if _are_alike(system, target):
        return (values * np.float32(system.unit)).astype(np.float32) if system.unit != 1.0 else values
    # The offset at the places of a lattice, bilinear between them.
    u, v = (np.linspace(a[0], a[-1], min(_LATTICE, len(a))) for a in (x, y))
    at_x, at_y = np.meshgrid(u, v)
    zero = vertical_shift(at_x.ravel(), at_y.ravel(), system, target, where).reshape(at_x.shape)
    offset = _between(zero, u, v, x, y)
    return (values * system.unit + offset).astype(np.float32)


def heights_in_metres(z: np.ndarray, x: np.ndarray, y: np.ndarray, system: HeightSystem, crs: str, where: str) -> np.ndarray:
    """Heights (N,) of a file at points x, y (N,) (m in `crs`) as heights of `crs`, float64 m. Raises as `in_metres` does."""
    target = CRS.from_user_input(crs)
    return z * system.unit + (0.0 if _are_alike(system, target) else vertical_shift(x, y, system, target, where))


def _are_alike(system: HeightSystem, target: CRS) -> bool:
    """Whether heights differ by their unit alone, as far as anybody can know."""
    return system.vertical is None or vertical(target) is None or system.vertical == vertical(target)


def vertical_shift(x: np.ndarray, y: np.ndarray, system: HeightSystem, target: CRS, where: str) -> np.ndarray:
    """What is to be added (N,) m to heights of a file at places (N,) of the target's plan system, once they are in metres."""
    with_grids_of_the_system()
    group = TransformerGroup(system.whole, target, always_xy=True)
    if leaves_heights(group):
        grids = missing_grids(group.unavailable_operations)
        missing = f" the grid {grids[0]} ({how_to_get(grids)})" if grids else " a grid that PROJ does not name"
        raise WorkflowError(
            f"The heights of {where} are in {system.vertical.name if system.vertical else system.whole.name}, those of the "
            f"project in "
            f"{target.name}, and their transformation needs{missing}; get it, or leave the height part out of 'crs': a constant "
            f"shift "
            "is then found from the photographs."
        )
    try:
        east, north = Transformer.from_crs(horizontal(target), system.plan, always_xy=True).transform(x, y)
        _, _, z = group.transformers[0].transform(east, north, np.zeros(len(x)))
    except ProjError as error:
        raise WorkflowError(
            f"The heights of {where} cannot be transformed ({error}); convert them to the project's system."
        ) from error
    return np.asarray(z)


def _between(values: np.ndarray, u: np.ndarray, v: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear values (len(y), len(x)) of a lattice (len(v), len(u)); rows may run south."""
    along = np.array([np.interp(x, u, row) for row in values])
    order = np.argsort(v)
    return np.array([np.interp(y, v[order], column[order]) for column in along.T]).T
