"""The picture of a check for the documentation: corrections on the left, what the check says of every cell on the right.

    python -m benchmarks check_picture runs/check-model docs/pictures/check.png [METRES]

Blue: the surface is too high by METRES (1) or more; red: too low. The codes have the colours of the report.
"""

from pathlib import Path

import cv2
import numpy as np
import rasterio

from benchmarks.measured_run import run_folders
from orthomill.schemas.surface import CHECK_CODES, CheckCode

_WIDTH = 460
"""px, of either half"""
_NOTHING = 235
"""grey value where nothing is known"""


def picture(dh: np.ndarray, code: np.ndarray, reach: float) -> np.ndarray:
    """uint8 (rows, cols, 3) red, green, blue of corrections (rows, cols) m beside their codes, cut to what has a height."""
    rows, cols = np.nonzero(code != CheckCode.EMPTY)
    part = np.s_[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    dh, code = dh[part], code[part]
    up = np.clip(np.nan_to_num(dh) / reach, -1, 1)
    shades = np.stack([1 + np.minimum(up, 0), 1 - np.abs(up), 1 - np.maximum(up, 0)], axis=-1)
    left = np.where(np.isfinite(dh)[..., None], 255 * shades, _NOTHING)
    right = np.full((*code.shape, 3), float(_NOTHING))
    for number, colour, _ in CHECK_CODES:
        if number != CheckCode.EMPTY:
            right[code == number] = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    height = round(_WIDTH * code.shape[0] / code.shape[1])
    halves = [cv2.resize(half, (_WIDTH, height), interpolation=cv2.INTER_AREA) for half in (left, right)]
    return np.concatenate([halves[0], np.full((height, 12, 3), 255.0), halves[1]], axis=1).astype(np.uint8)


def write_picture(run: Path, target: Path, reach: float) -> None:
    """The picture of a finished check."""
    with rasterio.open(run / "products" / "dsm_check.tif") as product:
        band = {text.split(" ")[0]: k + 1 for k, text in enumerate(product.descriptions)}
        dh, code = product.read(band["dh"]), product.read(band["code"], masked=True).filled(CheckCode.EMPTY)
    cv2.imwrite(str(target), cv2.cvtColor(picture(dh, np.nan_to_num(code), reach), cv2.COLOR_RGB2BGR))


def main(words: list[str]) -> None:
    """Draw the picture of a run."""
    if len(words) < 2:
        raise SystemExit("Name the folder of a check and the picture to write, and the metres of full colour if they are not 1.")
    write_picture(run_folders(words[:1])[0], Path(words[1]), float(words[2]) if len(words) > 2 else 1.0)
