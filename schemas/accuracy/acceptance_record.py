"""What an acceptance keeps beside its clauses, so that it is a document by itself: what was delivered, in which systems, when and
by which program it was tested, against which limits, and what the test found at each point."""

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.accuracy.accuracy_statement import AccuracyKind, AccuracyStatement
from orthomill.schemas.accuracy.point_tests import PointTest


class _Recorded(BaseModel):
    """Base of the parts of a record."""

    model_config = ConfigDict(frozen=True)


class AcceptedFile(_Recorded):
    """A file as it was when it was tested."""

    path: str
    """of a run: in its folder; of a delivery of another program: its name"""
    size: int
    """bytes"""
    sha256: str
    """hexadecimal"""


class StandardWording(_Recorded):
    """One accuracy in the words that ASPRS edition 2 prescribes."""

    kind: AccuracyKind
    about: str
    """which accuracy of which product"""
    sentence: str
    tested: bool
    """False: what a producer may declare without a test, which nothing found here supports"""


class SystemNames(_Recorded):
    """The reference system of a delivery by name; empty: nobody says."""

    plan: str = ""
    height: str = ""
    epoch: str = ""
    """whether one is needed, and which"""


class AcceptanceRecord(_Recorded):
    """All that a reader asks before the document is signed."""

    tested: str
    """ISO 8601, UTC"""
    version: str
    """of orthomill, which tested"""
    made: str = ""
    """by which version the products were made, and when; empty: of another program"""
    systems: SystemNames = SystemNames()
    first_day: str | None = None
    last_day: str | None = None
    """of the photographs, ISO 8601"""
    limits: dict[str, float | int | str | bool] = {}
    """what the profile asks for, by setting"""
    files: tuple[AcceptedFile, ...] = ()
    """what was delivered"""
    evidence: tuple[AcceptedFile, ...] = ()
    """what it was tested with: surveyed points, marks, orientations"""
    statement: AccuracyStatement = AccuracyStatement()
    points: tuple[PointTest, ...] = ()
    known: tuple[str, ...] = ()
    """what a run says of itself without surveyed points: agreement, promise"""
    doubts: tuple[str, ...] = ()
    """of a run about its own results"""
    remarks: tuple[str, ...] = ()
    """what was assumed"""
