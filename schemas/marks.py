"""Marks: points measured in photographs by a person, by matching or as targets, and what a block says of each of them."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from orthomill.schemas.observations import Distance

PointRole = Literal["control", "check", "tie", "unused"]
"""`unused`: kept with its marks, but given to no adjustment"""
MarkSource = Literal["hand", "matched", "target", "file"]


class Mark(BaseModel):
    """A point measured in one photograph: column and row (the centre of the upper-left pixel is (0, 0)) and their standard error,
    px."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    col: float
    row: float
    sigma: float = Field(0.5, gt=0, le=100)
    by: MarkSource = "hand"


class MarkedPoint(BaseModel):
    """A point with its marks. `xyz` in the project's system and `sigma`, m; None: its coordinates are not known."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str
    role: PointRole = "control"
    xyz: tuple[float, float, float] | None = None
    sigma: tuple[float, float, float] = (0.03, 0.03, 0.05)
    marks: dict[str, Mark] = {}
    """photo -> mark"""

    @property
    def known(self) -> bool:
        """Whether its coordinates take part: those of check points never do."""
        return self.role == "control" and self.xyz is not None


class HiddenArea(BaseModel):
    """A part of a photograph that is not to be used: its corners (col, row), px, in the upright photograph."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    photo: str
    corners: tuple[tuple[float, float], ...] = Field(min_length=3, max_length=1000)


class Marks(BaseModel):
    """All points of a project with their marks, the distances measured between them, and parts of photographs that are hidden."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    points: tuple[MarkedPoint, ...] = ()
    distances: tuple[Distance, ...] = ()
    areas: tuple[HiddenArea, ...] = ()


@dataclass(frozen=True)
class MarkVerdict:
    """What the block says of a mark. Residual: marked minus adjusted (col, row), px. `test`: its size in units of its own standard
    error, to be compared with `MarkJudgement.limit`; None where nothing checks the mark. `off` (col, row), px: how far it would be
    from the place that all other observations give it."""

    point: str
    photo: str
    residual: tuple[float, float]
    test: float | None
    off: tuple[float, float] | None


@dataclass(frozen=True)
class WrongMark:
    """Something that contradicts everything else: a mark (point and photo), or the coordinates of a point (photo None). `others`:
    photographs of the same point whose marks may be meant instead, where the observations cannot tell them apart. `instead`: the
    point whose place the mark has; `swapped`: its mark in this photograph has the place of this point."""

    point: str
    photo: str | None
    test: float
    off: tuple[float, float] | None = None
    others: tuple[str, ...] = ()
    instead: str | None = None
    swapped: bool = False


@dataclass(frozen=True)
class PlacedPoint:
    """Where all marks and coordinates put a point, m, its standard errors, and for one with coordinates the difference from these
    with its predicted standard errors (check points: of an observation that took no part)."""

    name: str
    xyz: tuple[float, float, float]
    sigma: tuple[float, float, float]
    difference: tuple[float, float, float] | None = None
    predicted: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class MarkJudgement:
    """All marks against the block and each other. `limit`: the test value beyond which a mark is wrong; `unit`: how many times
    larger than stated the marks scatter, where they do."""

    marks: tuple[MarkVerdict, ...]
    wrong: tuple[WrongMark, ...]
    points: tuple[PlacedPoint, ...]
    limit: float
    unit: float


@dataclass(frozen=True)
class ExpectedSight:
    """A photograph that should show a point: the predicted place (col, row), px; its covariance (2, 2) px^2; how it is known;
    `gain`: by how much a mark there lessens the standard error of the point (from, to), m; `inside`: px from the nearest border."""

    photo: str
    place: tuple[float, float]
    covariance: np.ndarray
    known: Literal["block", "matched", "tags"]
    gain: tuple[float, float]
    inside: float


@dataclass(frozen=True)
class MarkProposal:
    """Where matching or a target finds a point in a photograph (col, row), px, its standard error, and the correlation with the
    marks that there are, and that of the best other place; `refused`: why it should not be accepted, empty where nothing speaks
    against it."""

    photo: str
    place: tuple[float, float]
    sigma: float
    correlation: float
    rival: float
    refused: str = ""
    by: MarkSource = "matched"


TargetKind = Literal["chequered", "cross", "circle", "coded"]


@dataclass(frozen=True)
class FoundTarget:
    """A signalised target in a photograph: its kind, centre (col, row) px with standard error, half its width px, how surely it is
    one (0 to 1), and the name of a coded one."""

    kind: TargetKind
    place: tuple[float, float]
    sigma: float
    radius: float
    score: float
    name: str = ""


@dataclass(frozen=True)
class NextPoint:
    """A place worth surveying, m in the project's system: in how many photographs it is seen, and the largest standard error on the
    ground without and with it, m."""

    role: Literal["control", "check"]
    xyz: tuple[float, float, float]
    photographs: int
    before: float
    after: float
