"""Projection centres, their standard errors and approximate attitudes from a CSV file."""

import csv
import io
from dataclasses import dataclass

from orthomill.schemas.errors import WorkflowError

COLUMNS = ("photo", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
ANGLES = ("omega", "phi", "kappa")
"""optional columns: an approximate attitude, from which the ground that an oblique photograph shows is known"""

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Position:
    """A projection centre and its standard errors, m; omega, phi, kappa in degrees where the file has them."""

    xyz: Triple
    sigma: Triple
    attitude: Triple | None = None


def read_positions(text: str) -> dict[str, Position]:
    """The positions of a CSV file with the columns photo, x, y, z, sigma_x, sigma_y, sigma_z, by the name of the photograph.

    The extension of an image file after the name is dropped. Raises WorkflowError with the number of the line.
    """
    # Spreadsheet programs put a byte order mark in front of UTF-8; it would become part of the first column's name.
    reader = csv.DictReader(io.StringIO(text.lstrip("\ufeff")), skipinitialspace=True)
    missing = [column for column in COLUMNS if column not in (reader.fieldnames or ())]
    if missing:
        raise WorkflowError(
            f"The positions file has no column {', '.join(missing)}; its first line must name {', '.join(COLUMNS)}."
        )
    positions: dict[str, Position] = {}
    for row in reader:
        name = photo_stem(row["photo"])
        if name in positions:
            raise WorkflowError(
                f"Line {reader.line_num} of the positions file names the photograph {name} a second time; keep one of the lines."
            )
        positions[name] = _position(row, reader.line_num)
    return positions


def photo_stem(name: str | None) -> str:
    """The name of a photograph without the extension of an image file."""
    # Only extensions of images are cut off: names such as "flight.2" contain a dot of their own.
    head, dot, tail = (name or "").strip().rpartition(".")
    return head if dot and tail.lower() in {"jpg", "jpeg", "tif", "tiff", "png"} else (name or "").strip()


def _position(row: dict[str, str], line: int) -> Position:
    try:
        x, y, z, *sigma = (float(row[column]) for column in COLUMNS[1:])
    except (TypeError, ValueError):
        raise WorkflowError(
            f"Line {line} of the positions file does not hold six numbers after the photograph's name, but {dict(row)}."
        ) from None
    # Weights are reciprocal variances: a standard error of zero would be an infinite one.
    if min(sigma) <= 0:
        raise WorkflowError(
            f"Line {line} of the positions file gives a standard error of zero or less; all must be greater than zero."
        )
    return Position((x, y, z), (sigma[0], sigma[1], sigma[2]), _attitude(row, line))


def _attitude(row: dict[str, str], line: int) -> Triple | None:
    words = [(row.get(name) or "").strip() for name in ANGLES]
    if not any(words):
        return None
    try:
        omega, phi, kappa = map(float, words)
    except ValueError:
        raise WorkflowError(
            f"Line {line} of the positions file gives {', '.join(words)} for omega, phi, kappa; give three angles in "
            "degrees or none."
        ) from None
    return omega, phi, kappa
