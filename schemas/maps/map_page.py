"""The page that shows the products of a run as a map: its layers, and what it tells of a place."""

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table
from orthomill.schemas.stage_report import Picture


class _PagePart(BaseModel):
    model_config = ConfigDict(frozen=True)


class ValueLayer(_PagePart):
    """Rasters on the grid of the surface that answer for a place: "height", "sigma" and "code" by their names in the store."""

    name: str
    title: str
    rasters: dict[str, str]
    codes: tuple[tuple[int, str, str], ...] = ()
    """(code, colour, meaning)"""


class MapCamera(_PagePart):
    """A photograph: its projection centre, m, and the outline of what it shows of the ground, (x, y) m."""

    name: str
    centre: tuple[float, float, float]
    outline: tuple[tuple[float, float], ...]
    taken: str = ""


class CloudLayer(_PagePart):
    """The surface as points in space: rasters of heights, of the codes whose cells are `shown`, and of colours on a grid of their
    own, by their names in the store."""

    height: str
    code: str
    shown: tuple[int, ...]
    colours: str | None = None


class MapPage(_PagePart):
    """Everything that the page is made of, but rasters and lines."""

    project: str
    pictures: tuple[Picture, ...]
    values: tuple[ValueLayer, ...]
    cameras: tuple[MapCamera, ...]
    system: str
    cloud: CloudLayer | None = None


MAP_PAGE = Table("viewer/page.json", MapPage)
