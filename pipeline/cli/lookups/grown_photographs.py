"""`orthomill grow`: two photographs of which nothing is known, read with the checking readers; the matches as CSV, and a table.

The catalogue provides the method; this file knows files and lines.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from orthomill.pipeline.cli.lookups.inspect_photo import GuardedPhoto
from orthomill.pipeline.storage.file_names import shown
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.inspections.inspection import GrownPair
from orthomill.schemas.photo import Header
from orthomill.schemas.raster import Window
from orthomill.schemas.survey_files.sniffed_table import lines_of, separation

_WEIGHTS = np.array([0.299, 0.587, 0.114])
"""of red, green and blue in grey (ITU-R BT.601)"""
_AGREE = 0.6
"""share of the matches below which an orientation is doubted: nearly all agree with the true one, half of them with another"""


def grey_of(path: Path) -> tuple[Header, np.ndarray]:
    """Header and grey values (rows, cols) uint8 of a photograph as it is stored. Raises PhotoError."""
    photo = GuardedPhoto(path)
    header = photo.header
    pixels = photo.read(Window(0, 0, header.height, header.width))
    grey = pixels[..., :3] @ _WEIGHTS if pixels.shape[2] >= 3 else pixels[..., 0].astype(np.float64)
    if pixels.dtype != np.uint8:
        low, high = np.percentile(grey[::8, ::8], [1.0, 99.0])
        grey = (grey - low) * (254.0 / max(high - low, 1e-9)) + 1.0
    return header, np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def read_seeds(path: Path) -> np.ndarray:
    """(S, 4) px of a list of seeds: col and row on the left, col and row on the right, one a line. Raises WorkflowError."""
    if not path.is_file():
        raise WorkflowError(f"There is no list of seeds {shown(path)}.")
    lines = [line for _, line in lines_of(path.read_text(encoding="utf-8-sig", errors="replace")).others]
    sign, rows = separation(lines), []
    for line in lines:
        numbers = [sign.number(cell) for cell in sign.cells(line)]
        if len(numbers) == 4 and None not in numbers:
            rows.append(numbers)
    if not rows:
        raise WorkflowError(
            f"{shown(path)} holds no seeds; a line is: col and row on the left, col and row on the right, in pixels."
        )
    return np.array(rows, np.float64)


def matches_csv(pair: GrownPair) -> str:
    """The matches, one a line."""
    rows = np.column_stack([pair.matches, pair.sigma])
    lines = (",".join(f"{value:.3f}" for value in row) for row in rows.tolist())
    return "\n".join(["left_col,left_row,right_col,right_row,sigma", *lines, ""])


def grown_lines(pair: GrownPair) -> Iterator[str]:
    """What the terminal shows."""
    share = 100.0 * len(pair.matches) / max(pair.nodes, 1)
    yield (
        f"{len(pair.matches)} of {pair.nodes} nodes matched ({share:.0f} %) from {pair.seeds} seeds, to "
        f"{np.median(pair.sigma):.3f} px "
        "(median standard error of a coordinate)."
    )
    if not pair.unknowns:
        yield "No camera constant is known, so there is no relative orientation; give --c in pixels."
        return
    yield f"Relative orientation from {pair.kept} of {pair.related} matches that agree, sigma0 {pair.sigma0_px:.3f} px:"
    if pair.kept < _AGREE * pair.related:
        yield (
            f"Only {pair.kept} of {pair.related} matches agree: this may be another orientation than the true one. Give seeds all "
            "over the common ground (--seeds), or a smaller --step."
        )
    if pair.turned:
        yield "Image systems turned by 90 degrees, so that the base lies along x."
    for one in pair.unknowns:
        yield f"  {one.name:10} {one.value:11.5f} +- {one.sigma:.5f} {one.unit}".rstrip()
    yield (
        "Neither principal point nor distortion is known here: the standard errors allow for 1 % of the frame in each, and for 1 % "
        "of the camera constant. A project with a calibration relates its pairs better: orthomill relative."
    )
