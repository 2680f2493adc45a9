"""The origin taken off the coordinates of a text for programs of single precision, as a line of comment that is read back."""

from typing import NamedTuple

_NOTE = "# Coordinates are those of the reference system less the origin:"


class NotedOrigin(NamedTuple):
    """X, Y, Z (m) that were taken off, and the reference system."""

    xyz: tuple[float, float, float]
    crs: str


def origin_note(origin: NotedOrigin) -> str:
    """The line."""
    x, y, z = origin.xyz
    return f"{_NOTE} {x:.3f} {y:.3f} {z:.3f} of {origin.crs}\n"


def noted_origin(text: str) -> NotedOrigin | None:
    """What a text notes; None for the texts of other programs."""
    line = next((line for line in text.splitlines() if line.startswith(_NOTE)), None)
    if line is None:
        return None
    x, y, z, _, crs = line.removeprefix(_NOTE).split(maxsplit=4)
    return NotedOrigin((float(x), float(y), float(z)), crs)
