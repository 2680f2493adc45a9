"""Products held against surveyed points that took no part in making them."""

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table
from orthomill.schemas.orientation import DistanceResidual

TESTED = "tested"
"""the reason of a point that can be tested"""
WITHOUT_HEIGHT = "the point was surveyed without a height"
UNEVEN = "beside an edge, a hole or estimated heights, where photographs show other ground than the orthoimage"


class _Tested(BaseModel):
    """Base of the parts of a test."""

    model_config = ConfigDict(frozen=True)


class HeightTest(_Tested):
    """The surface at the place of a point."""

    reason: str
    """TESTED, or a sentence why its height says nothing here"""
    height: float | None = None
    """m, of the surface at the point's place; also where it is not tested, if there is one"""
    sigma: float | None = None
    """m, standard error that the surface states there; None: it states none"""
    datum: float | None = None
    """m, the part of it that is the place of the block, which neighbours share; None: not stated"""
    slope: float | None = None
    """rise over run of the ground around"""
    step: float | None = None
    """m, by which the ground around leaves its plane at most"""
    uneven: bool = False
    """whether edges, holes or estimated heights are among the cells around: what is seen there depends on from where"""

    @property
    def tested(self) -> bool:
        """Whether the height was compared; `reason` says why not."""
        return self.reason == TESTED

    @property
    def counted(self) -> float | None:
        """The height that is tested, m; None where it is not."""
        return self.height if self.tested else None


class PlaceTest(_Tested):
    """Where the orthoimage shows a point, by the patches of the photographs in which it was marked."""

    reason: str
    """TESTED, or a sentence why it was not found"""
    place: tuple[float, float] | None = None
    """X, Y in the orthoimage, m; None where it was not found"""
    sigma: tuple[float, float] | None = None
    """m, standard errors of the place: matching and marks"""
    photos: int = 0
    """photographs whose patches were found"""
    promised: tuple[float, float] | None = None
    """m, standard errors that orientations and surface promise for a place in the orthoimage; None: fixed orientations"""

    @property
    def tested(self) -> bool:
        """Whether the place was compared; `reason` says why not."""
        return self.reason == TESTED


class PointTest(_Tested):
    """A check point with all that is known against it."""

    name: str
    surveyed: tuple[float, float, float]
    """X, Y, Z, m"""
    sigma: tuple[float, float, float]
    """m, standard errors of the survey"""
    vegetated: bool = False
    """whether it was marked as under vegetation"""
    height: HeightTest | None = None
    """of dsm.tif; None: there is none"""
    corrected: HeightTest | None = None
    """of the surface after its check; None: not checked"""
    terrain: HeightTest | None = None
    """of terrain.tif, the bare ground; None: there is none"""
    place: PlaceTest | None = None
    """in ortho.tif; None: there is none"""
    block: tuple[float, float, float] | None = None
    """rays of the block minus survey, m; None: too few rays"""
    block_predicted: tuple[float, float, float] | None = None
    """standard errors that the adjustment predicts for these differences, survey included, m"""

    @property
    def height_difference(self) -> float | None:
        """Surface minus survey, m; None where it was not tested."""
        return self.difference(self.height)

    @property
    def height_predicted(self) -> float | None:
        """Standard error that surface and survey promise for that difference, m; None where the surface promises none."""
        return self.predicted(self.height)

    def difference(self, test: HeightTest | None) -> float | None:
        """One of its heights minus survey, m; None where it was not tested."""
        counted = test.counted if test else None
        return None if counted is None else counted - self.surveyed[2]

    def predicted(self, test: HeightTest | None) -> float | None:
        """Standard error that this height and the survey promise for that difference, m; None where none is promised."""
        if test is None or not test.tested or test.sigma is None:
            return None
        return float((test.sigma**2 + self.sigma[2] ** 2) ** 0.5)

    @property
    def place_difference(self) -> tuple[float, float] | None:
        """Orthoimage minus survey in X and Y, m; None where it was not tested."""
        if self.place is None or not self.place.tested or self.place.place is None:
            return None
        return self.place.place[0] - self.surveyed[0], self.place.place[1] - self.surveyed[1]

    @property
    def place_predicted(self) -> tuple[float, float] | None:
        """Standard errors that orientations, surface, survey and the measurement of the place promise for these differences, m."""
        if self.place is None or not self.place.tested or self.place.promised is None or self.place.sigma is None:
            return None
        known = zip(self.place.promised, self.place.sigma, self.sigma[:2], strict=True)
        x, y = (float((own**2 + found**2 + survey**2) ** 0.5) for own, found, survey in known)
        return x, y


class PointTests(_Tested):
    """All check points of a project, and the distances measured to them."""

    points: tuple[PointTest, ...] = ()
    distances: tuple[DistanceResidual, ...] = ()
    """of the block: those that took no part in it"""
    area_km2: float = 0.0
    """of the surface with heights"""
    surface_promised: float | None = None
    """m: root mean square of the standard errors that the surface promises wherever a point could test it; None: not known"""


POINT_TESTS = Table("accuracy/points.json", PointTests)


def point_table(number: int) -> Table[PointTest]:
    """Where the test of check point `number` is stored."""
    return Table(f"accuracy/points/{number}.json", PointTest)
