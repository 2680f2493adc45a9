"""How the size of a matching window is chosen: the names that the command and the inspection of a photograph share."""

from enum import StrEnum


class Method(StrEnum):
    """How the window is sized."""

    STATISTICAL = "statistical"
    ENTROPY = "entropy"
    FOERSTNER = "foerstner"
    COMBINED = "combined"
