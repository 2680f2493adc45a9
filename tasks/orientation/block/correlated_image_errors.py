"""Correlated image errors: estimated from the residuals of an adjusted block, carried into its standard errors, and reported where
they matter."""

from dataclasses import replace

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.findings.camera_findings import ImageErrorsCorrelated
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, CorrelatedErrors
from orthomill.tasks.adjustment.testing.error_field_precision import with_correlated_errors
from orthomill.tasks.adjustment.testing.error_fields import correlated_errors
from orthomill.tasks.adjustment.testing.predicted_fields import predicted_fields
from orthomill.tasks.orientation.block.assembly import BlockResults, Problem

NOTABLE = 2.0
"""Standard errors that grow by less are not reported: the estimate of the correlation itself is no better than that."""
# Lenses that err alike by hundredths of a pixel multiply the standard error of a constant known to a tenth of a permille.
SLIGHT = 1e-3
"""Standard errors of c, x0 and y0, in units of c, that are not reported however they grew: a permille of all heights"""
SHAPE = 3
"""c, x0, y0, the first parameters of INTERIOR: a surveyor reads their standard errors, and correlated errors affect them most."""


def including_correlation(results: BlockResults) -> BlockResults:
    """The block results whose standard errors include the correlated image errors that the residuals show."""
    problem, result, size = results.problem, results.result, results.problem.frame_sizes
    errors = correlated_errors(result, size)
    if errors is None:
        return results
    # A free block has no other observations that say anything of the fields.
    known = None if result.network.free else predicted_fields(result, errors, size).known
    correlated = with_correlated_errors(result, errors, size, known)
    return replace(results, result=correlated, findings=(*results.findings, *_notable(problem, result, correlated, errors)))


def _notable(
    problem: Problem, white: Adjustment, correlated: Adjustment, errors: CorrelatedErrors
) -> tuple[ImageErrorsCorrelated, ...]:
    """The unknown that lost most precision: of the adjusted interior orientations, or else of the projection centres."""
    unknowns = _unknowns(problem, white)
    columns = np.array(sorted(unknowns))
    # Rounding can leave variances slightly below 0.
    small, large = (np.sqrt(np.maximum(result.cofactor.variances[columns], 0.0)) for result in (white, correlated))
    growth = np.divide(large, small, out=np.ones_like(large), where=small > 0)
    growth[large < np.array([SLIGHT * problem.constant_of(unknowns[int(column)][1]) for column in columns])] = 1.0
    worst = int(growth.argmax())
    if growth[worst] < NOTABLE:
        return ()
    parameter, owner = unknowns[int(columns[worst])]
    return (
        ImageErrorsCorrelated(
            rms_px=errors.rms_px,
            shown_px=_shown_px(white, errors),
            camera_share=errors.share,
            parameter=parameter,
            owner=owner,
            sigma=float(large[worst]),
            white_sigma=float(small[worst]),
        ),
    )


def _shown_px(result: Adjustment, errors: CorrelatedErrors) -> float:
    """Root mean square of a coordinate of what the fields explain of the residuals, px."""
    residual = result.residual[result.used]
    return float(np.sqrt(max(1.0 - errors.white, 0.0) * np.mean(residual**2)))


def _unknowns(problem: Problem, result: Adjustment) -> dict[int, tuple[str, str]]:
    """Column -> parameter and camera of the interior parameters that are adjusted; without any, axis and photograph of the
    projection centres."""
    # Considered parameters keep the variance that was given for them: nothing of it can grow.
    columns = np.where(result.network.interior.considered, -1, result.network.interior_columns)
    found = {int(columns[k, i]): (INTERIOR[i], problem.camera_names[k]) for k, i in np.argwhere(columns[:, :SHAPE] >= 0)}
    return found or {6 * i + k: (axis, name) for i, name in enumerate(problem.names) for k, axis in enumerate("XYZ")}
