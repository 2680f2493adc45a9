"""What stands on the ground, told by its surface: roofs are smooth and were measured, crowns are neither.

Strategy. Cells far above the ground whose measured heights lie on a plane with those around, in a patch as wide as the least roof,
are the core of a building; what is not ground around a core, as wide as the photographs see no roof at its edge, belongs to it.
Whatever else stands on the ground is a plant, by its height.

Source for the classes: ASPRS, LAS Specification 1.4 - R15.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from orthomill.schemas.bare_ground import CellClass, TerrainCode

LOW, HIGH = 0.5, 2.0
"""m above the ground up to which plants are low, and from which on they are high"""
LEAST_ROOF_HEIGHT = 2.0
"""m above the ground"""
_FLAT = 3.0
"""a roof is as flat as this many of its standard errors allow"""
_LEAST_FLATNESS = 0.25
"""share of a cell that a flat surface may be off its plane: tiles, parapets, and the grid itself"""


@dataclass(frozen=True)
class RoofRules:
    """Cells along the radius of the least roof, and around the core of a roof that still belong to the building."""

    core: int
    rim: int

    @property
    def halo(self) -> int:
        """Cells around a tile that its classes follow from."""
        return 2 * self.core + self.rim + 2


def roof_cells(above: np.ndarray, sigma: np.ndarray, measured: np.ndarray, cell: float, rules: RoofRules) -> np.ndarray:
    """Which cells (rows, cols) bool belong to buildings, ground around them included.

    above, sigma (rows, cols) m: height above the ground and its standard error; measured (rows, cols) bool; `cell` m.
    """
    high = measured & (above > LEAST_ROOF_HEIGHT)
    # A plane leaves no second difference; the median of four of them forgives a ridge, not a crown.
    bends = np.stack([np.abs(_second_difference(above, step)) for step in ((0, 1), (1, 0), (1, 1), (1, -1))])
    flat = high & (np.nan_to_num(np.median(bends, axis=0), nan=np.inf) <= np.maximum(_FLAT * sigma, _LEAST_FLATNESS * cell))
    # Distances cost the same for any disc; a structuring element of some hundred cells takes minutes and gigabytes.
    # Nothing is known beyond the window: there is no roof.
    bent = np.pad(~flat, 1, constant_values=True)
    middles = _squared_distance(bent)[1:-1, 1:-1] > rules.core**2
    core = _squared_distance(middles) <= rules.core**2
    return _squared_distance(core) <= rules.rim**2


def _second_difference(values: np.ndarray, step: tuple[int, int]) -> np.ndarray:
    """Half of it (rows, cols) across `step`: how far a cell is off the line between its neighbours, NaN at the border."""
    out = np.full(values.shape, np.nan, np.float32)
    down, right = step
    rows, cols = values.shape
    inner = values[1 : rows - 1, 1 : cols - 1]
    one = values[1 + down : rows - 1 + down, 1 + right : cols - 1 + right]
    other = values[1 - down : rows - 1 - down, 1 - right : cols - 1 - right]
    out[1 : rows - 1, 1 : cols - 1] = inner - 0.5 * (one + other)
    return out


def _squared_distance(there: np.ndarray) -> np.ndarray:
    """Of every cell (rows, cols) to the nearest one that is `there`, in cells squared."""
    if not there.any():
        return np.full(there.shape, np.inf)
    away = cv2.distanceTransform((~there).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.rint(away.astype(np.float64) ** 2)


def terrain_codes(there: np.ndarray, measured: np.ndarray, bridged: np.ndarray, above: np.ndarray, roof: np.ndarray) -> np.ndarray:
    """uint8 TerrainCode (rows, cols): where there is terrain, where it was measured, where it is bridged (bool); `above` m."""
    # A gap with nothing above it hides no ground: there simply was none measured.
    covered = bridged & (above > LOW)
    codes = np.full(there.shape, TerrainCode.EMPTY, np.uint8)
    codes[there] = TerrainCode.GUESSED
    codes[there & covered] = TerrainCode.UNDER_WOOD
    codes[there & bridged & roof] = TerrainCode.UNDER_BUILDING
    codes[there & measured] = TerrainCode.MEASURED
    return codes


def cell_classes(codes: np.ndarray, above: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """uint8 CellClass (rows, cols) from the codes of the terrain, the height `above` it (m), and whether the surface was `seen`,
    not
    estimated (bool)."""
    height = np.nan_to_num(above)
    plants = np.select(
        [height > HIGH, height > LOW], [CellClass.HIGH_VEGETATION, CellClass.MEDIUM_VEGETATION], CellClass.LOW_VEGETATION
    )
    classes = np.where(codes == TerrainCode.UNDER_WOOD, plants, CellClass.UNCLASSIFIED)
    classes = np.where((codes == TerrainCode.UNDER_BUILDING) & (height > LOW), CellClass.BUILDING, classes)
    # An estimate at the level of the ground is no ground that anybody saw.
    classes = np.where((codes == TerrainCode.MEASURED) & seen, CellClass.GROUND, classes)
    return np.where((codes == TerrainCode.EMPTY) | np.isnan(above), CellClass.NONE, classes).astype(np.uint8)


def point_classes(z: np.ndarray, ground: np.ndarray, sigma: np.ndarray, cell_class: np.ndarray) -> np.ndarray:
    """uint8 CellClass (N,) of points: heights z, the ground and its standard error (m) and the class of the cells that they lie
    in."""
    above = z - ground
    near = np.maximum(3.0 * sigma, LOW)
    classes = np.where(np.isfinite(above), cell_class, CellClass.UNCLASSIFIED)
    standing = np.isin(
        classes, (CellClass.BUILDING, CellClass.HIGH_VEGETATION, CellClass.MEDIUM_VEGETATION, CellClass.LOW_VEGETATION)
    )
    classes = np.where(standing & (np.abs(above) <= 0.5 * LOW), CellClass.GROUND, classes)
    classes = np.where((classes == CellClass.GROUND) & (above > near), CellClass.UNCLASSIFIED, classes)
    classes = np.where((classes == CellClass.WATER) & (np.abs(above) > near), CellClass.UNCLASSIFIED, classes)
    return np.where((above < -near) & (cell_class != CellClass.WATER), CellClass.LOW_NOISE, classes).astype(np.uint8)
