"""The truth of a simulated scene: names, types and codes of its rasters, and the tables that a survey would deliver.

Rasters and tables of the truth carry `readers=TRUTH_READERS`: only `simulation` and `evaluation` may read them. The rasters lie
on one `MapGrid` (TRUTH_GRID); a height is that of the cell's centre.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from orthomill.schemas.job import Columns, Table
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid

TRUTH_READERS = ("simulation", "evaluation")

TRUTH_SURFACE = "truth/surface"
"""float32 m (rows, cols): height of the visible surface (ground, roofs, crowns, water; no vehicles, poles and wires) at the cell's
centre. Of a crown it is the envelope without wind: leaves begin at it or below it, and some rays pass through to the ground."""
TRUTH_GROUND = "truth/ground"
"""float32 m (rows, cols): height of the bare ground, also below roofs and below crowns, through whose gaps photographs see it; of
water its surface."""
TRUTH_ORTHO = "truth/ortho"
"""uint8 (rows, cols, 3): the true orthoimage without vehicles, poles, wires, wind and glints, before any camera's gain, offset,
vignetting and noise."""
TRUTH_MATERIAL = "truth/material"
"""uint8 (rows, cols): code of Material."""
TRUTH_BUILDING = "truth/building"
"""uint16 (rows, cols): number of the building, counted from 1; 0 where there is none."""
# One bit per photograph limits a simulation to 32 photographs; a raster for each would take eight times the space and more reads.
TRUTH_VISIBILITY = "truth/visibility"
"""uint32 (rows, cols): bit i is set where photo i of TRUTH_BLOCK truly sees the cell's centre (inside the photo, not occluded;
vehicles, poles and wires are ignored, crowns hide whatever is behind them). `(mask >> i) & 1`."""


# The front of a solid scene: on a plane grid with x along the facade and y upwards, in metres of the scene and not of the project.
TRUTH_FRONT_ORTHO = "truth/front/ortho"
"""uint8 (rows, cols, 3): the true orthoimage of a facade, without people and leaves, before any camera's exposure and noise."""
TRUTH_FRONT_DEPTH = "truth/front/depth"
"""float32 m (rows, cols): distance of what is seen from the plane of the facade, towards the viewer; NaN where nothing is."""
TRUTH_FRONT_VISIBILITY = "truth/front/visible"
"""uint32 (rows, cols): bit i is set where photo i of TRUTH_BLOCK truly sees the place; people and leaves are ignored."""


class Material(IntEnum):
    """Material of the surface as seen from above."""

    # Counted from 1: 0 is the fill value of rasters and must not be a material.
    OPEN_GROUND = 1
    FIELD = 2
    ROAD = 3
    ROOF = 4
    TREE = 5
    WATER = 6
    VEHICLE = 7
    WIRE = 8


OPEN_MATERIALS = (Material.OPEN_GROUND, Material.FIELD, Material.ROAD, Material.VEHICLE, Material.WIRE)
"""bare, textured ground; on VEHICLE one stands while some photograph is taken, above WIRE hangs a wire or stands a pole"""

MATERIAL_CLASSES: tuple[tuple[int, str, str], ...] = (
    (Material.OPEN_GROUND, "#b8b37a", "open ground"),
    (Material.FIELD, "#9bbf5a", "field"),
    (Material.ROAD, "#8c8c8c", "road"),
    (Material.ROOF, "#c1523c", "roof"),
    (Material.TREE, "#2f6b33", "tree"),
    (Material.WATER, "#3d6fa3", "water"),
    (Material.VEHICLE, "#e6c229", "ground on which a vehicle stands in some photograph"),
    (Material.WIRE, "#5b3a8c", "ground below wires and at poles"),
)
"""(code, colour, meaning) for pictures of TRUTH_MATERIAL."""


@dataclass(frozen=True)
class PositionRows(Columns):
    """One row per photograph: its projection centre as measured by a GNSS receiver."""

    photo: np.ndarray
    """str"""
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    sigma_x: np.ndarray
    sigma_y: np.ndarray
    sigma_z: np.ndarray
    """float64, m"""


@dataclass(frozen=True)
class ControlRows(Columns):
    """One row per surveyed ground point."""

    name: np.ndarray
    role: np.ndarray
    """str: control or check"""
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    sigma_x: np.ndarray
    sigma_y: np.ndarray
    sigma_z: np.ndarray
    """float64, m"""


@dataclass(frozen=True)
class MeasurementRows(Columns):
    """One row per image measurement of a surveyed ground point."""

    name: np.ndarray
    photo: np.ndarray
    """str"""
    col: np.ndarray
    row: np.ndarray
    sigma: np.ndarray
    """float64, px"""


TRUTH_GRID = Table("truth/grid.json", MapGrid, TRUTH_READERS)
TRUTH_FRONT_GRID = Table("truth/front_grid.json", MapGrid, TRUTH_READERS)
TRUTH_BLOCK = Table("truth/block.json", Block, TRUTH_READERS)
"""True orientations and camera (source "truth"); sigma0_px 0; photos in the order of the visibility bits; ground_low and
ground_high are the lowest and highest of the bare ground and everything on it."""
POSITIONS_TABLE = Table("simulation/positions.parquet", PositionRows)
CONTROL_TABLE = Table("simulation/control.parquet", ControlRows)
MEASUREMENTS_TABLE = Table("simulation/measurements.parquet", MeasurementRows)
