"""What `init` says of a flight before anything is computed: what the tags of the photographs tell, and what is to be expected."""

from pydantic import BaseModel, ConfigDict


class ExpectedFlight(BaseModel):
    """What a planned block lets expect, from the positions alone; a sentence each, None where it is not known."""

    model_config = ConfigDict(frozen=True)

    pattern: str | None = None
    """one strip, grid, cross, circle; overlap along and across"""
    bend: str | None = None
    """whether the block can bend, and what to measure to stop it"""
    accuracy: str | None = None
    """expected standard errors in plan and height"""
    effort: str | None = None
    """hours and memory of a run"""

    @property
    def lines(self) -> tuple[str, ...]:
        """What is known of it, a line each."""
        return tuple(line for line in (self.pattern, self.bend, self.accuracy, self.effort) if line)


class PositionsBeside(BaseModel):
    """A positions file that lies beside photographs: its path in the project, and its text."""

    model_config = ConfigDict(frozen=True)

    path: str
    text: str


class FirstLook(BaseModel):
    """Findings in photographs, one sentence each; which of them make the block, as paths; what to expect of it."""

    model_config = ConfigDict(frozen=True)

    findings: tuple[str, ...]
    used: tuple[str, ...]
    band: str | None = None
    """The band of which the block is made, where others were set aside."""
    ellipsoidal: bool = False
    """All positions have heights above the ellipsoid."""
    expected: ExpectedFlight = ExpectedFlight()

    @property
    def lines(self) -> tuple[str, ...]:
        """Findings, and below them what to expect."""
        return *self.findings, *self.expected.lines
