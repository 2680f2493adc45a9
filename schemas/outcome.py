"""The outcome of one attempt to match a point: a code in arrays, a sentence for people."""

from enum import IntEnum


class Outcome(IntEnum):
    """uint8 in arrays."""

    # Zero is the fill value of rasters: nodes that no job wrote read as not tried. The numbers are stored: append new ones.
    NOT_TRIED = 0
    CONVERGED = 1
    LOW_TEXTURE = 2
    OUTSIDE = 3
    NOT_CONVERGED = 4
    MOVED_TOO_FAR = 5
    SINGULAR = 6
    LOW_CORRELATION = 7
    INCONSISTENT = 8
    OCCLUDED = 9
    IMPRECISE = 10

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        return _SENTENCES[self]


_SENTENCES = {
    Outcome.NOT_TRIED: "no attempt was made here",
    Outcome.CONVERGED: "matched",
    Outcome.LOW_TEXTURE: "too little texture in the window",
    Outcome.OUTSIDE: "the window leaves the image",
    Outcome.NOT_CONVERGED: "the iterations did not converge",
    Outcome.MOVED_TOO_FAR: "the solution moved too far from its start",
    Outcome.SINGULAR: "the normal equations are singular",
    Outcome.LOW_CORRELATION: "the matched windows are not similar enough",
    Outcome.INCONSISTENT: "matching back does not return to the point, or its neighbours contradict it",
    Outcome.OCCLUDED: "something higher hides the point from one of the photographs",
    Outcome.IMPRECISE: "the match is less precise than required",
}
