"""What the positions of a project were read from: which format, in which system, and what was assumed."""

from typing import Literal

from pydantic import BaseModel, ConfigDict


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
    by: Literal["workflow", "file", "degrees", "project"]
    """what told the reference system: `degrees`: the numbers can be nothing else; `project`: nothing"""
    matched: Literal["name", "number", "order"] = "name"
    confirmed: Literal["times", "places"] | None = None
    """what shows that events belong to the photographs, where the file has no names"""
    exchanged: bool = False
    """whether the northing (or latitude) came first, against what the columns say"""
    defaults: tuple[float, float] | None = None
    """standard errors in plan and height (m) that were taken, where the file states none"""
    raised: int = 0
    """positions of a float or single solution whose standard errors were enlarged to what such a solution is worth"""
    without: int = 0
    """lines without a position"""
    angles: str | None = None
    """which angles became attitudes"""
    antenna: bool = False
    """positions are those of the antenna, not of the camera"""
    encoding: str = "UTF-8"
