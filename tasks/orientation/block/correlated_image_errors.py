"""Errors in common, from the residuals of an adjusted block into its standard errors and into words."""

from dataclasses import replace

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.tasks.adjustment.model.adjustment_result import Adjustment
from orthomill.tasks.adjustment.testing.error_field_precision import with_correlated_errors
from orthomill.tasks.adjustment.testing.error_fields import correlated_errors
from orthomill.tasks.orientation.block.assembly import BlockResults, Problem

NOTABLE = 2.0
"""Standard errors that grow by this factor are spoken of."""
OF_CAMERA = 0.5
"""From this share on the fields are said to be the camera's, below to be those of single photographs."""


def carried(account: BlockResults) -> BlockResults:
    """The account whose standard errors carry the errors in common that its residuals show, with a sentence where that matters."""
    problem, result = account.problem, account.result
    size = np.array([(problem.cameras[k].width, problem.cameras[k].height) for k in problem.camera_of], float)
    errors = correlated_errors(result, size)
    if errors is None:
        return account
    honest = with_correlated_errors(result, errors, size)
    return replace(account, result=honest, remarks=(*account.remarks, *_told(problem, result, honest)))


def _told(problem: Problem, white: Adjustment, honest: Adjustment) -> tuple[str, ...]:
    """Names what grew most: of the interior orientations, where they are adjusted, else of the projection centres."""
    names = _names(problem, white)
    columns = np.array(sorted(names))
    small, large = (np.sqrt(np.maximum(result.cofactor.variances[columns], 0.0)) for result in (white, honest))
    growth = np.divide(large, small, out=np.ones_like(large), where=small > 0)
    worst = int(growth.argmax())
    if growth[worst] < NOTABLE:
        return ()
    whose = (
        "mostly alike in all photographs, as where the lens bends otherwise than its distortion parameters can say"
        if honest.correlated.share >= OF_CAMERA
        else "mostly different in each, as a stabiliser that shifts the sensor, a slow shutter or uneven film does it"
    )
    return (
        f"Errors in common: whole regions of a photograph are displaced together, by {honest.correlated.rms_px:.2f} px on average, "
        f"{whose}. The standard errors carry it: that of {names[int(columns[worst])]} is {large[worst]:.2g}; if every measurement "
        f"erred by itself it would be {small[worst]:.2g}. Calibrate the camera, switch stabilisers off, add photographs turned by "
        "90 degrees.",
    )


def _names(problem: Problem, result: Adjustment) -> dict[int, str]:
    """What stands in the columns of interior parameters that are adjusted; of projection centres where none is."""
    columns = np.where(result.network.interior.considered, -1, result.network.interior_columns)
    found = {int(columns[k, i]): f"{INTERIOR[i]} of {problem.camera_names[k]}" for k, i in np.argwhere(columns[:, :3] >= 0)}
    return found or {6 * i + k: f"{axis} of {name}" for i, name in enumerate(problem.names) for k, axis in enumerate("XYZ")}
