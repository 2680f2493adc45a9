"""The settings of region growing."""

from pydantic import model_validator

from orthomill.schemas.settings import Settings, refuse_ignored, setting
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching

_MATCHING = LeastSquaresMatching(window=21, smoothing=0.6, max_shift=2.0)


class RegionGrowing(Settings):
    """How regions grow."""

    levels: int = setting(2, "Distances from a solved node, in steps, at which its neighbours are tried.", ge=1, le=3)
    region: int = setting(32, "Side of the regions that grow independently; 0: one region.", "nodes", ge=0, le=4096)
    crossings: int = setting(2, "How often growth may enter ground without seeds from adjacent regions.", ge=0, le=16)
    seeds: int = setting(2, "Seeds along each side of a region, when they are not given.", ge=1, le=64)
    matching: LeastSquaresMatching = setting(_MATCHING, "Least-squares matching of the nodes.")
    min_neighbours: int = setting(0, "Of the eight neighbours of a node, how many must predict it.", ge=0, le=8)
    neighbour_tolerance: float = setting(0.75, "Largest difference from a neighbour's prediction.", "px", gt=0.0)

    @model_validator(mode="after")
    def _everything_has_an_effect(self) -> "RegionGrowing":
        if self.region == 0:
            refuse_ignored(self, ("crossings",), "region: 0", "divide the grid into regions, or leave it out")
        if self.min_neighbours == 0:
            refuse_ignored(self, ("neighbour_tolerance",), "min_neighbours: 0", "ask for neighbours, or leave it out")
        return self
