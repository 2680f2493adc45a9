"""The settings by which interest points are found, and matched by normalised correlation."""

from typing import Literal

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.gaussian_reach import reach_of


class TemplateCorrelation(Settings):
    """How points are matched by normalised correlation."""

    template: int = setting(21, "Side of the template; an even number is taken as the next odd one.", "px", ge=5, le=101)
    search: int = setting(201, "Side of the search window; the template stays inside.", "px", ge=7, le=2001)
    min_correlation: float = setting(0.85, "Correlation that a match must reach.", ge=-1.0, le=1.0)
    min_deviation: float = setting(2.0, "Standard deviation that both windows must have.", "grey values", gt=0.0)
    max_return: float | None = setting(
        2.0, "Largest distance from the point after matching back; null: matching back is omitted.", "px", ge=0.0
    )

    @property
    def half(self) -> int:
        """Half side of the template, px, without its middle pixel."""
        return self.template // 2

    @property
    def reach(self) -> int:
        """Largest distance of a place from its start, along rows and columns, px."""
        return max(self.search // 2 - self.half, 1)


class _Detector(Settings):
    sigma: float = setting(1.5, "Sigma of the Gaussian that the products of gradients are averaged with.", "px", ge=0.5, le=5.0)
    radius: int = setting(3, "A point is the strongest within this distance along rows and columns.", "px", ge=1, le=50)

    @property
    def reach(self) -> int:
        """Pixels around a tile that its points depend on."""
        return 1 + 2 * reach_of(self.sigma) + self.radius


class HarrisPoints(_Detector):
    """Harris operator with Noble's measure."""

    kind: Literal["harris"] = "harris"
    min_strength: float = setting(
        3000.0,
        "Noble's measure that a point must exceed, for grey values of 0 to 255 and undivided Prewitt masks.",
        "grey values^2",
        gt=0.0,
    )
