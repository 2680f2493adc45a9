"""The settings of the steps of guided densification."""

from typing import Literal

from orthomill.schemas.settings import Settings, setting


class BandCorrelation(Settings):
    """How a point is matched within its interval."""

    template: int = setting(21, "Side of the template; an even number is taken as the next odd one.", "px", ge=5, le=101)
    min_correlation: float = setting(0.8, "Correlation that a match must reach.", ge=-1.0, le=1.0)
    min_deviation: float = setting(2.0, "Standard deviation that both windows must have.", "grey values", gt=0.0)
    sub_pixel: bool = setting(
        True, "Whether a parabola through three correlations refines the column; the publication stops at pixels."
    )

    @property
    def half(self) -> int:
        """Half side of the template, px, without its middle pixel."""
        return self.template // 2


AUTO_SQUARE = 48.0
"""px of the matched images along the side of the square: the 20 m of the publication at its 0.43 m"""
_DOUBLINGS = 2


class ColumnInterval(Settings):
    """How far along its row the homologue of a pixel is searched."""

    square: Literal["auto"] | float = setting(
        "auto", "Side of the square about the point on the guide whose heights count; auto is 48 pixels of the matched images.", "m"
    )
    extremes: Literal["lowest_highest", "symmetric"] = setting(
        "lowest_highest",
        "The ends: the lowest and the highest height in the square, or as far below and above the point as those lie apart.",
    )
    min_points: int = setting(3, "With fewer points of the guide in the square it is doubled, twice at most.", ge=1, le=1000)
    margin: float = setting(3.0, "Added on both sides.", "px of the matched images", ge=0.0, le=200.0)

    def side(self, pixel: float) -> float:
        """Side of the square, m; pixel: of the matched images on the ground, m."""
        return AUTO_SQUARE * pixel if self.square == "auto" else float(self.square)

    @staticmethod
    def reach(side: float) -> float:
        """How far from a point of the guide heights can count, m."""
        return side / 2 * 2**_DOUBLINGS


AUTO_RADIUS = 24.0
"""px of the matched images: the 10 m of the publication at its 0.43 m"""


class OutlierDetector(Settings):
    """Removal of spikes from the points of a level."""

    radius: Literal["auto"] | float = setting(
        "auto", "Radius of the circle of neighbours; auto is 24 pixels of the matched images.", "m"
    )
    sigmas: float = setting(3.0, "Standard deviations of the neighbours by which a height may differ from their mean.", gt=0.0)
    includes_point: bool = setting(False, "Whether the point that is tested counts among its neighbours.")

    def reach(self, pixel: float) -> float:
        """Radius, m; pixel: of the matched images on the ground, m."""
        return AUTO_RADIUS * pixel if self.radius == "auto" else float(self.radius)
