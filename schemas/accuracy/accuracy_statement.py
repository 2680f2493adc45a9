"""What tests at independent points let one say of products, as ASPRS edition 2 words it, with how sure it is."""

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table

AccuracyKind = Literal["horizontal", "nva", "vva", "nva_terrain", "vva_terrain", "three_dimensional"]
"""in plan; in height on open ground and under vegetation, of the surface and of the bare ground; in plan and height together"""
HEIGHTS: tuple[AccuracyKind, ...] = ("nva", "vva", "nva_terrain", "vva_terrain")


SURE = 2.58
"""standard errors of a block's place beyond which an error is more than it promises: one of a hundred sound blocks is as far off"""


def class_of(rmse: float) -> int:
    """Accuracy class of a root mean square error (m): the least whole number of centimetres that it does not exceed.

    Source: ASPRS Positional Accuracy Standards for Digital Geospatial Data, edition 2 (2023).
    """
    # Rounded first: 0.29 m is 28.999... cm in binary, and must not become 29 by luck alone.
    return max(1, math.ceil(round(100 * rmse, 6)))


class _Stated(BaseModel):
    """Base of the parts of a statement."""

    model_config = ConfigDict(frozen=True)


class AccuracyFigure(_Stated):
    """Root mean square errors of one kind at n points, m."""

    kind: AccuracyKind
    points: int
    needed: int
    """points that a formal statement needs for an area of this size"""
    fit: float
    """of the differences themselves"""
    survey: float
    """of the survey of the points, as it was stated"""
    rmse: float
    """root of the sum of squares of both: what the standard calls the accuracy of the product"""
    low: float
    high: float | None
    """95 % confidence interval of the product's own `rmse`, for so few points: without `measuring` at the low end; None: a single
    point tells no upper end"""
    mean: float
    """mean difference, m (in height), or the length of the mean difference in plan"""
    robust: float | None
    """NMAD in height, None for other kinds"""
    at_68: float | None = None
    """68.3 % of the differences are no larger, counted; None in statements of earlier versions"""
    at_90: float
    """90 % of the differences are no larger: LE90 or CE90, counted and not computed from the RMSE"""
    at_95: float
    measuring: float | None = None
    """m: standard error of the places in the orthoimage themselves (marks, matching), which `fit` contains; None in height"""
    promised: float | None
    """root mean square of differences in units of their promised standard errors; None where nothing is promised"""
    promised_here: float | None = None
    promised_everywhere: float | None = None
    """m: root mean squares of the standard errors that the surface promises at these points, and wherever points could test it, by
    whose difference the interval is widened; None where they are not known"""
    class_cm: int
    """accuracy class by the standard's formula"""
    proved_cm: int | None
    """the class that this test proves with 97.5 %, by `high`"""
    sentence: str
    """as the standard words it"""

    @property
    def formal(self) -> bool:
        """Whether there are as many points as a formal statement needs."""
        return self.points >= self.needed


class NamedError(_Stated):
    """An error that all differences share, named for what it is."""

    kind: Literal["feet", "shift_up", "tilt", "dome", "scale_up", "shift_plan", "turn", "scale"]
    size: float
    """m: what it does at most within the points"""
    sigma: float
    """m: its standard error"""
    displaced: float = 0.0
    """m: root mean square of what it does at the points"""
    promised: float | None = None
    """m: standard error that the block promises of its place there, root mean square as well; None: nothing is promised"""
    sentence: str

    @property
    def is_promised(self) -> bool:
        """Whether a block as good as it says may have it: it is found, and no reason to doubt."""
        if self.promised is None:
            return False
        known = self.sigma * self.displaced / self.size
        return self.displaced <= SURE * math.hypot(self.promised, known)


class DistanceFigure(_Stated):
    """Measured distances that took no part in the block, against it."""

    distances: int
    contradicting: tuple[str, ...] = ()
    """those that contradict the block while all others agree with it, as "A to B"; they are in no other figure"""
    fit: float
    """m: root mean square of block minus measured"""
    promised: float
    """root mean square of these differences in units of their promised standard errors, in which the measurement has its part"""
    scale: float
    """parts per million by which the block is longer: the sum of the differences over that of the lengths"""
    scale_sigma: float
    """parts per million: its standard error, were the errors of all distances the same; independent ones leave a smaller one"""
    sentence: str


class AccuracyStatement(_Stated):
    """All that is stated of the products."""

    figures: tuple[AccuracyFigure, ...] = ()
    named: tuple[NamedError, ...] = ()
    distances: DistanceFigure | None = None
    """of the block, whose scale the products have; None: no distance to a check point was measured"""
    untested: tuple[tuple[str, str], ...] = ()
    """(point, why its height or place says nothing), of those that were not counted"""
    level: Literal["tested", "promised"] = "promised"
    """whether independent points tested a product, or only precision is promised"""

    def of(self, kind: AccuracyKind) -> AccuracyFigure | None:
        """The figure of a kind; None where it was not tested."""
        return next((figure for figure in self.figures if figure.kind == kind), None)


STATEMENT = Table("accuracy/statement.json", AccuracyStatement)
