"""What the positions of a project were read from: which format, in which system, and what was assumed."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

ToldBy = Literal["workflow", "file", "degrees", "geocentric", "project"]


class HeightsOfPositions(BaseModel):
    """What the heights of the positions refer to, and whether they were transformed to the vertical datum of the project."""

    model_config = ConfigDict(frozen=True)

    system: str | None
    """the surface that they were read from, e.g. "ellipsoid of WGS 84"; None: nothing tells it"""
    target: str | None
    """the vertical datum of the project; None: it has none, and heights keep their values"""
    transformed: int
    """how many were transformed"""
    unknown: int = 0
    """how many have a height of which nothing tells what it refers to"""


class PositionsRead(BaseModel):
    """A positions file as it was read."""

    model_config = ConfigDict(frozen=True)

    format: str
    """the program or the convention that it follows"""
    positions: int
    used: int
    """those of photographs that the project has"""
    crs: str
    by: ToldBy
    """what told the reference system: `degrees`, `geocentric`: the numbers can be nothing else; `project`: nothing"""
    matched: Literal["name", "number", "order"] = "name"
    confirmed: Literal["times", "places"] | None = None
    """what shows that events belong to the photographs, where the file has no names"""
    exchanged: bool = False
    """whether the northing (or latitude) came first, against what the columns say"""
    defaults: tuple[float, float] | None = None
    """standard errors in plan and height (m) that were taken, where the file states none"""
    unstated: int = 0
    """positions of which the file states no standard errors"""
    raised: int = 0
    """positions of a float or single solution whose standard errors were enlarged to what such a solution is worth"""
    rounded_m: float | None = None
    """the step (m) to which coordinates are written, where standard errors had to be enlarged for it"""
    heights_of_tags: int = 0
    """positions whose heights are those of the GPS tags, because the file has none"""
    moved: int = 0
    """by how many photographs its lines have to be moved to lie where the GPS tags are; 0: they lie there"""
    off_tags_m: float | None = None
    """by how much the positions are off the GPS tags in plan (m, median), where no receiver explains it"""
    above_tags_m: float | None = None
    """by how much they are above the heights of the tags (m, median), where no receiver explains it"""
    stepped: tuple[tuple[str, ...], float] | None = None
    """photographs whose heights are off the tags by another amount than those of the others, and by how much more, m"""
    without: int = 0
    """lines without a position"""
    angles: str | None = None
    """which angles became attitudes"""
    antenna: bool = False
    """positions are those of the antenna, not of the camera"""
    encoding: str = "UTF-8"
