"""Projection centres, their standard errors and approximate attitudes from a CSV file."""

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.tasks.geometry.coordinate_ranges import coordinate_mistake, height_mistake, sigma_mistake

COLUMNS = ("photo", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
ANGLES = ("omega", "phi", "kappa")
"""optional columns: an approximate attitude, from which the ground that an oblique photograph shows is known"""

_WHOLE_TURNS = 3600.0  # degrees; larger angles are other numbers

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Position:
    """A projection centre and its standard errors, m; omega, phi, kappa in degrees where the file has them."""

    xyz: Triple
    sigma: Triple
    attitude: Triple | None = None


def read_positions(text: str) -> dict[str, Position]:
    """The positions of a CSV file with the columns photo, x, y, z, sigma_x, sigma_y, sigma_z, by the name of the photograph.

    The extension of an image file after the name is dropped. Raises WorkflowError with the first mistakes, one a line.
    """
    positions: dict[str, Position] = {}
    mistakes: list[str] = []
    for line, row in _rows(text):
        name, found = photo_stem(row["photo"]), _position(row)
        if isinstance(found, str):
            mistakes.append(f"Line {line} of the positions file {found}.")
        elif name in positions:
            mistakes.append(f"Line {line} of the positions file names the photograph {name} a second time; keep one of the lines.")
        else:
            positions[name] = found
    if mistakes:
        raise WorkflowError(first_of(mistakes))
    return positions


def _rows(text: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Number of the line and cells by column, absent ones empty. Raises WorkflowError for a file that is no table."""
    # Spreadsheet programs put a byte order mark in front of UTF-8; it would become part of the first column's name.
    reader = csv.DictReader(io.StringIO(text.lstrip("\ufeff")), skipinitialspace=True, restval="")
    try:
        missing = [column for column in COLUMNS if column not in (reader.fieldnames or ())]
        if missing:
            raise WorkflowError(
                f"The positions file has no column {', '.join(missing)}; its first line must name {', '.join(COLUMNS)}."
            )
        yield from ((reader.line_num, row) for row in reader)
    except csv.Error as error:
        raise WorkflowError(
            f"Line {reader.line_num + 1} of the positions file cannot be read ({error}); look for quotes."
        ) from None


def photo_stem(name: str | None) -> str:
    """The name of a photograph without the extension of an image file."""
    # Only extensions of images are cut off: names such as "flight.2" contain a dot of their own.
    head, dot, tail = (name or "").strip().rpartition(".")
    return head if dot and tail.lower() in {"jpg", "jpeg", "tif", "tiff", "png"} else (name or "").strip()


def _position(row: dict[str, str]) -> Position | str:
    """The position of a line, or what is wrong with it, as the end of a sentence."""
    try:
        x, y, z, *sigma = (float(row[column]) for column in COLUMNS[1:])
    except ValueError:
        shown = ", ".join(row[column][:20] for column in COLUMNS[1:])
        return f"does not hold six numbers after the photograph's name, but {shown!r}"
    found = [(name, coordinate_mistake(value)) for name, value in zip("xy", (x, y), strict=True)]
    found += [
        ("z", height_mistake(z)),
        *((f"sigma_{name}", sigma_mistake(value)) for name, value in zip("xyz", sigma, strict=True)),
    ]
    for name, mistake in found:
        if mistake:
            return f"is wrong: {name} {mistake}"
    attitude = _attitude(row)
    return attitude if isinstance(attitude, str) else Position((x, y, z), (sigma[0], sigma[1], sigma[2]), attitude)


def _attitude(row: dict[str, str]) -> Triple | str | None:
    words = [(row.get(name) or "").strip() for name in ANGLES]
    if not any(words):
        return None
    try:
        omega, phi, kappa = map(float, words)
    except ValueError:
        omega = phi = kappa = math.nan
    if not all(abs(angle) <= _WHOLE_TURNS for angle in (omega, phi, kappa)):
        return f"gives {', '.join(word[:20] for word in words)} for omega, phi, kappa; give three angles in degrees or none"
    return omega, phi, kappa
