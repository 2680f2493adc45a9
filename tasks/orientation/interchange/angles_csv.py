"""Exterior orientation as a table: photo, X, Y, Z, omega, phi, kappa in metres and degrees, and standard errors where known.

Commas, semicolons, tabs or blanks part the columns. The first line names them; without such a line the seven stand in this order,
as aerial triangulation programs write them. R = R3(kappa) R2(phi) R1(omega), world to image.
"""

import re

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.orientation import Block
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock, ForeignPose, photo_name

COLUMNS = ("photo", "x", "y", "z", "omega", "phi", "kappa")
SIGMAS = ("sigma_x", "sigma_y", "sigma_z", "sigma_omega", "sigma_phi", "sigma_kappa")
_ALSO = {
    "filename": "photo", "image": "photo", "name": "photo", "label": "photo", "#photo": "photo",
    "easting": "x", "northing": "y", "altitude": "z", "height": "z",
}  # fmt: skip


def read_angles(text: str) -> ForeignBlock:
    """The table as a block without cameras. Raises WorkflowError naming every line that is wrong."""
    rows = [(number, _cells(line)) for number, line in enumerate(text.lstrip("\ufeff").splitlines(), 1) if line.strip()]
    names, rows = _columns(rows)
    poses: dict[str, ForeignPose] = {}
    mistakes = []
    for number, cells in rows:
        row = dict(zip(names, cells, strict=False))
        name, pose = photo_name(row.get("photo", "")), _pose(row)
        if pose is None:
            mistakes.append(f"Line {number} of the exterior orientation does not hold six numbers behind the photograph: {cells}.")
        elif name in poses:
            mistakes.append(f"Line {number} of the exterior orientation names the photograph {name} a second time; keep one.")
        else:
            poses[name] = pose
    if mistakes or not poses:
        raise WorkflowError("\n".join(mistakes) or "The exterior orientation holds no line with a photograph.")
    return ForeignBlock(poses, {}, np.zeros((0, 3)))


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"[,;\t]" if re.search(r"[,;\t]", line) else r"\s+", line.strip())]


def _columns(rows: list[tuple[int, list[str]]]) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The names of the columns, and the rows below them; lines that begin with # are comments."""
    first = [_ALSO.get(word.lower(), word.lower()) for word in rows[0][1]] if rows else []
    if set(COLUMNS) <= set(first):
        return first, [row for row in rows[1:] if not row[1][0].startswith("#")]
    rows = [row for row in rows if not row[1][0].startswith("#")]
    if rows and len(rows[0][1]) == len(COLUMNS) and _pose(dict(zip(COLUMNS, rows[0][1], strict=True))):
        return list(COLUMNS), rows
    missing = ", ".join(name for name in COLUMNS if name not in first)
    raise WorkflowError(
        f"The exterior orientation lacks the column(s) {missing}; its first line must name {', '.join(COLUMNS)}, in metres and "
        "degrees."
    )


def _pose(row: dict[str, str]) -> ForeignPose | None:
    try:
        numbers = np.array([float(row[name]) for name in COLUMNS[1:]])
        stated = all(row.get(name) for name in SIGMAS)
        sigma = np.array([float(row[name]) for name in SIGMAS]) if stated else None
    except (KeyError, ValueError):
        return None
    if not np.isfinite(numbers).all() or (sigma is not None and not (sigma > 0).all()):
        return None
    if sigma is not None:
        sigma = np.concatenate([sigma[:3], np.radians(sigma[3:])])
    return ForeignPose(rotation_matrix(*np.radians(numbers[3:])), numbers[:3], sigma)


def write_angles(block: Block) -> str:
    """All photographs of a block, with standard errors where the adjustment gave them; with digits enough to read the block back
    as it was (nanometres, and 1e-12 degrees)."""
    lines = [",".join((*COLUMNS, *SIGMAS))]
    for photo in block.photos:
        numbers = [f"{v:.9f}" for v in photo.centre] + [f"{v:.12f}" for v in photo.omega_phi_kappa]
        lines.append(",".join([photo.photo, *numbers, *_sigmas(photo.covariance)]))
    return "\n".join(lines) + "\n"


def _sigmas(covariance: tuple[tuple[float, ...], ...] | None) -> list[str]:
    if covariance is None:
        return [""] * len(SIGMAS)
    sigma = np.sqrt(np.diag(np.array(covariance)))
    return [f"{v:.5f}" for v in sigma[:3]] + [f"{v:.7f}" for v in np.degrees(sigma[3:])]
