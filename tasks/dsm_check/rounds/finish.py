"""The answer after several passes: what the photographs say against the surface as it was given, and the surface mended.

Where a height is far from the second surface and no pass at full resolution judged it, it is coded: probably a large error, beyond
what can be told.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.raster import Window
from orthomill.schemas.surface import ESTIMATED, CheckCode
from orthomill.tasks.dsm_check.areas import blocks, slopes
from orthomill.tasks.dsm_check.correction_map import CorrectionMap, clearly_wrong, detectable_error
from orthomill.tasks.dsm_check.statistics import TileCounts, count_tile
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceTrend
from orthomill.tasks.dsm_check.tile import CheckedCells, Conditions, CorrectionRule, cell_codes


@dataclass(frozen=True)
class Finish:
    """`back`: what is added to the corrected heights, m, so that a surface keeps its own height system; `own`: standard error of
    its heights (m), which a difference must exceed together with that of the check."""

    rule: CorrectionRule
    back: float
    own: float = 0.0


def finish(
    *,
    window: Window,
    wide: Window,
    how: Finish,
    given: np.ndarray,
    height: np.ndarray,
    residual: np.ndarray,
    precision: np.ndarray,
    disputed: np.ndarray,
    counts: TileCounts,
    provenance: np.ndarray | None = None,
    filled: np.ndarray | None = None,
    far: np.ndarray | None = None,
    trend: SurfaceTrend | None = None,
) -> CheckedCells:
    """The checked cells of `window`.

    Arrays (wide.shape), a cell larger to every side: heights as given and after the last pass (m), what
    is still asked for and its standard error (m). Arrays (window.shape): disputed, provenance, where the photographs filled holes,
    and far from the second surface (uint8). trend: what is taken out of the corrected surface with its shift; None where it stays.
    """
    rule, inside = how.rule, window.within(wide).slices
    judged = np.isfinite(residual)
    after = np.where(judged, height, given)
    error = np.hypot(np.where(judged, precision, np.nan), how.own).astype(np.float32)
    whole = CorrectionMap(np.where(judged, after - given + residual, np.nan).astype(np.float32), error)
    wrong = clearly_wrong(whole, rule.significance)[inside]
    given, after = given[inside], after[inside]

    estimated = np.isin(np.zeros(window.shape, np.uint8) if provenance is None else provenance, ESTIMATED)
    known = judged[inside] & ~estimated
    after = np.where(known, after, given)
    correction = CorrectionMap(*(np.where(known, band[inside], np.float32(np.nan)) for band in (whole.dh, whole.sigma)))
    # Several passes may have changed a cell by less than the limit of one.
    share = (known & (np.abs(np.nan_to_num(after - given)) > 0)).astype(np.float32)
    unconfirmed = ~known & np.isfinite(given) & (far > 0) if far is not None else np.zeros(window.shape, np.bool_)
    back = np.float32(how.back) if trend is None else np.float32(how.back) + trend.at(window)
    code = cell_codes(given, correction, share, Conditions(wrong, estimated, disputed > 0))
    code[unconfirmed] = CheckCode.BEYOND_REACH
    if filled is not None:
        code[filled > 0] = CheckCode.FILLED
    found = count_tile(given, correction, share, estimated, counts.pairs, rule.pixel_height, rule.cell)
    coarse = blocks(correction.dh, correction.sigma, rule.block), slopes(given, correction.dh, rule.block, rule.cell)
    return CheckedCells(
        dh=correction.dh,
        precision=correction.sigma,
        test=(correction.dh / correction.sigma).astype(np.float32),
        detectable=detectable_error(correction.sigma, rule.significance),
        height=(after + back).astype(np.float32),
        code=code,
        coarse=np.concatenate(coarse, axis=-1),
        counts=found.model_copy(update={"beyond": int(unconfirmed.sum()), "shown": counts.shown}),
    )
