"""A product under evaluation, and the truth that its jobs read."""

from dataclasses import dataclass

from orthomill.schemas.job import Raster, Region
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.evaluation.grids import Placement, readable
from orthomill.tasks.evaluation.report.heights_section import DH

Reads = dict[str, Region | tuple[Region, ...]]
DIFFERENCES = {"heights": DH, "heights_before_check": "evaluation/dh_before_check"}
ORTHO_AXES = ("ortho_y", "ortho_x")
"""The orthoimage has smaller cells than the height differences in the same group."""


@dataclass(frozen=True)
class JudgedProduct:
    """A product under evaluation: its map grid in tiles of `tile`, its `crs`, and its reference."""

    grid: MapGrid
    crs: str
    tile: int
    reference: MapGrid | str
    """grid of the truth, or path of the reference file"""
    sigma: float = 0.0
    """standard error of the heights of a reference file, m"""


def truth_reads(place: Placement, **names: str) -> Reads:
    """The truth rasters of a placement, as reads under the given names."""
    return {key: Raster(name, readable(place)) for key, name in names.items()}


def pixels_scratch(place: Placement, bytes_per_pixel: int) -> int:
    """Working memory on the pixels of the truth, bytes."""
    return array_bytes(bytes_per_pixel, place.window)
