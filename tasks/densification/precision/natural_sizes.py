"""How high and deep what stands on the ground is, where nothing measured tells.

Trees, houses and leaves have their sizes in metres, whatever a flight's ground pixel is. Cells finer than any flight has show an
object and not a landscape: a wall, a column, a model. There the same is as many cells high as in the finest flight.
"""

LEAVES, GRASS = 1.5, 0.4
"""m: leaves of one crown differ by so much in depth, and blades of grass"""
HOUSE, TALLEST = 2.5, 10.0
"""m: the least rise of a house, and the height of trees and houses"""
_FINEST = 0.01
"""m: cells of the finest flights"""


def natural(size: float, cell: float) -> float:
    """A `size` (m) of what stands on the ground, where cells are `cell` (m) wide."""
    return size * min(1.0, cell / _FINEST)
