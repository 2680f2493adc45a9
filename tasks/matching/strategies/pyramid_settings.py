"""The settings of matching from coarse to fine."""

from pydantic import model_validator

from orthomill.schemas.settings import Settings, refuse_ignored, setting
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching

_COARSE = LeastSquaresMatching(window=11, interpolation="bilinear", stop=0.2, max_iterations=10, max_shift=4.0)
_FINE = LeastSquaresMatching(window=15, smoothing=0.6, interpolation="bicubic", stop=0.05, max_iterations=10, max_shift=2.0)


class PyramidMatching(Settings):
    """How a grid of nodes is matched from coarse to fine."""

    levels: int = setting(4, "Coarser levels above the photographs themselves, at most; each halves them.", ge=0, le=8)
    coarse_step: int = setting(4, "Distance of the nodes on the coarser levels.", "px of the level", ge=1, le=16)
    coarse: LeastSquaresMatching = setting(_COARSE, "Least-squares matching on the coarser levels.")
    fine: LeastSquaresMatching = setting(_FINE, "Least-squares matching on the photographs themselves.")
    start_spacing: float = setting(
        3.0, "Distance of the starts that cover the search range on the coarsest level.", "px of that level", gt=0.0
    )
    weak_sigma: float = setting(0.1, "Standard error above which a node is tried with the wide window.", "px of the level", gt=0.0)
    wide_window: int = setting(
        31, "Side of the window for failed and for poorly determined nodes.", "px of the level", ge=5, le=101
    )
    min_neighbours: int = setting(2, "Of the eight neighbours of a node, how many must predict it.", ge=0, le=8)
    neighbour_tolerance: float = setting(0.75, "Largest difference from a neighbour's prediction.", "px of the level", gt=0.0)

    @model_validator(mode="after")
    def _everything_has_an_effect(self) -> "PyramidMatching":
        if self.levels == 0:
            refuse_ignored(self, ("coarse_step", "coarse"), "levels: 0", "set levels to 1 or more, or leave them out")
        if self.min_neighbours == 0:
            refuse_ignored(self, ("neighbour_tolerance",), "min_neighbours: 0", "ask for neighbours, or leave it out")
        return self
