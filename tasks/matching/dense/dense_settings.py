"""The settings of dense matching of a pair."""

from itertools import pairwise
from typing import Literal

from pydantic import model_validator

from orthomill.schemas.settings import Settings, setting


class DenseMatching(Settings):
    """How a pair of epipolar images is matched densely."""

    step: Literal[1, 2, 4] = setting(2, "Distance of the nodes.", "px")
    window: int = setting(
        15, "Side of the least-squares window on smooth surfaces; an even number is taken as the next odd one.", "px", ge=7, le=41
    )
    small_window: int = setting(9, "Side of the window where the surface bends.", "px", ge=5, le=41)
    edge_window: int = setting(5, "Side of the window where the surface breaks within the other.", "px", ge=5, le=41)
    wide_window: int = setting(31, "Side of the window where texture is weak.", "px", ge=7, le=101)
    weak_sigma: float = setting(0.1, "Standard error of a parallax above which wider windows are tried.", "px", gt=0.0)
    smoothing: float = setting(0.5, "Sigma of the Gaussian that both images are smoothed with.", "px", ge=0.0, le=3.0)
    max_shift: float = setting(1.5, "A node that ends farther than this from its start is rejected.", "px", gt=0.0)
    surface_tolerance: float = setting(1.0, "Pixels of the window farther from the surface of the node are excluded.", "px", gt=0.0)
    min_support: float = setting(0.3, "Share of the window that must lie on the node's surface.", gt=0.0, le=1.0)
    min_correlation: float = setting(0.6, "Normalised correlation that the matched windows must reach.", ge=0.0, le=1.0)
    min_gradient: float = setting(0.5, "Root mean square grey value gradient along the row.", "grey values per px", ge=0.0)
    max_sigma: float = setting(0.5, "Largest standard error of a parallax.", "px", gt=0.0)
    min_neighbours: int = setting(3, "Of the eight neighbours of a node, how many must agree with it.", ge=0, le=8)
    neighbour_tolerance: float = setting(1.5, "Largest parallax difference of neighbours that agree.", "px", gt=0.0)

    @model_validator(mode="after")
    def _windows_ascend(self) -> "DenseMatching":
        names = ("edge_window", "small_window", "window", "wide_window")
        for smaller, larger in pairwise(names):
            if getattr(self, smaller) // 2 > getattr(self, larger) // 2:
                raise ValueError(
                    f"{smaller} is {getattr(self, smaller)} and {larger} is {getattr(self, larger)}; {smaller} must not be larger"
                )
        return self
