"""What the coarse blocks say all over the surface: its corrections, the smallest error that is found, shares of a tolerance."""

from math import nan

import numpy as np

from orthomill.tasks.dsm_check.areas import CHECKED, MEAN, SIGMA, CoarseBlocks, is_judged
from orthomill.tasks.dsm_check.correction_map import POWER, detectable_error

Values = dict[str, float | int | None]


def corrections_rms(coarse: CoarseBlocks) -> float | None:
    """Root mean square (m) of the corrections of the blocks (rows, cols, 5); None where nothing was judged."""
    known = coarse[is_judged(coarse)].astype(np.float64)
    weight = known[:, CHECKED].sum()
    return float(np.sqrt((known[:, CHECKED] * known[:, MEAN] ** 2).sum() / weight)) if weight else None


def tolerance_values(coarse: CoarseBlocks, significance: float, tolerance: float | None) -> Values:
    """Shares of the judged ground that keep a tolerance (m), break it, or cannot be told, from the blocks (rows, cols, 5) of the
    check."""
    known = coarse[is_judged(coarse)].astype(np.float64)
    weight = known[:, CHECKED].sum()
    if tolerance is None or not weight:
        return dict.fromkeys(("proved", "broken", "untold"))
    size, sigma = np.abs(known[:, MEAN]), known[:, SIGMA]
    # Proved: what was found, and what the test might have missed beside it, are together within the tolerance.
    proved = size + POWER * sigma <= tolerance
    broken = size - significance * sigma > tolerance
    shares = [round(100 * float(known[cells, CHECKED].sum() / weight), 1) for cells in (proved, broken, ~proved & ~broken)]
    return dict(zip(("proved", "broken", "untold"), shares, strict=True))


def median_detectable(coarse: CoarseBlocks, significance: float) -> float:
    """m: the smallest error that is found in half of the judged blocks (rows, cols, 3); NaN without any."""
    judged = is_judged(coarse)
    return float(np.median(detectable_error(coarse[judged][:, SIGMA], significance))) if judged.any() else nan
