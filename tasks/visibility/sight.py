"""How a photograph sees a place, whatever the surface is: the words that height models and meshes share, and the one question.

Each surface answers with its own geometry: a height model by rays that must stay above it (`lines_of_sight.py`), a mesh by the
triangles drawn around the image of the place (`mesh_sight.py`). What colours, counts and reports it asks for these codes only.

Source: visibility as in Petsa et al. 2007 (sources/blending.md, M5; the break of the depth in a photograph, M9).
"""

from enum import IntEnum
from typing import Protocol

import numpy as np

from orthomill.tasks.geometry.view import View


class PlaceSight(IntEnum):
    """How a photograph sees a place; uint8 in rasters. The higher the better; from AT_BREAK on it sees the place for certain."""

    NOWHERE = 0
    """there is no surface"""
    OUTSIDE = 1
    """beside the frame of the photograph, or behind it"""
    MASKED = 2
    AWAY = 3
    """the surface shows its back"""
    HIDDEN = 4
    BEHIND_ESTIMATE = 5
    """hidden by heights that are only estimated, or by less than heights are uncertain"""
    AT_BREAK = 6
    """seen next to a break of the depth in the photograph"""
    SEEN = 7


class SurfacePlaces(Protocol):
    """Places on a surface."""

    def sights(self, view: View) -> np.ndarray:
        """uint8 codes of PlaceSight, one for each place, in the shape in which the places are held."""
