"""Exterior orientation as a table: photo, X, Y, Z, omega, phi, kappa in metres and degrees, and standard errors where known.

Commas, semicolons, tabs or blanks separate the columns. The first line names them; without it there are these seven in this order,
as aerial triangulation programs write them. R = R3(kappa) R2(phi) R1(omega), world to image.
"""

import re

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.orientation import Block
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock, ForeignPose

COLUMNS = ("photo", "x", "y", "z", "omega", "phi", "kappa")
SIGMAS = ("sigma_x", "sigma_y", "sigma_z", "sigma_omega", "sigma_phi", "sigma_kappa")
_PHOTO = ("filename", "image", "name", "label", "#photo")
_ALSO = dict.fromkeys(_PHOTO, "photo") | {"easting": "x", "northing": "y", "altitude": "z", "height": "z"}
"""Names of columns in files of other programs -> those of COLUMNS"""


def read_angles(text: str) -> ForeignBlock:
    """The table as a block without cameras. Raises WorkflowError that names every wrong line."""
    rows = [(number, _cells(line)) for number, line in enumerate(text.lstrip("\ufeff").splitlines(), 1) if line.strip()]
    names, rows = _columns(rows)
    poses: dict[str, ForeignPose] = {}
    mistakes = []
    for number, cells in rows:
        row = dict(zip(names, cells, strict=False))
        name, pose = photo_stem(row.get("photo", "")), _pose(row)
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
    """The cells of a line. Blanks separate only where nothing else does: names of photographs may hold them."""
    return [cell.strip() for cell in re.split(r"[,;\t]" if re.search(r"[,;\t]", line) else r"\s+", line.strip())]


def _columns(rows: list[tuple[int, list[str]]]) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The names of the columns, and the rows below them; lines that begin with # are comments."""
    # Programs name the same column differently; capitals do not matter.
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
    """The pose of a row; None where a number is missing, not finite, or a standard error that is not positive."""
    try:
        numbers = np.array([float(row[name]) for name in COLUMNS[1:]])
        # All six standard errors or none: weights for some of the parameters would need a guess for the others.
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
    """All photographs of a block, with standard errors where the adjustment gave them, and enough digits to read the same block
    back (nanometres, and 1e-12 degrees)."""
    lines = [",".join((*COLUMNS, *SIGMAS))]
    for photo in block.photos:
        numbers = [f"{v:.9f}" for v in photo.centre] + [f"{v:.12f}" for v in photo.omega_phi_kappa]
        lines.append(",".join([photo.photo, *numbers, *_sigmas(photo.covariance)]))
    return "\n".join(lines) + "\n"


def _sigmas(covariance: tuple[tuple[float, ...], ...] | None) -> list[str]:
    """The cells of the standard errors in metres and degrees, empty where there is no covariance."""
    if covariance is None:
        return [""] * len(SIGMAS)
    sigma = np.sqrt(np.diag(np.array(covariance)))
    return [f"{v:.5f}" for v in sigma[:3]] + [f"{v:.7f}" for v in np.degrees(sigma[3:])]
