"""The datum of a block as it is told after the adjustment: what took part, and what has been explained since the start."""

from dataclasses import replace

import numpy as np

from orthomill.schemas.findings.camera_findings import ConstantContradicted
from orthomill.schemas.findings.datum_findings import DatumMisfit
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.orientation.block.assembly import Problem
from orthomill.tasks.orientation.block.camera_constant import Tested
from orthomill.tasks.orientation.start.georeference import Datum, datum_sentence


def as_adjusted(datum: Datum, problem: Problem, result: Adjustment) -> Datum:
    """The datum with the sentence of what took part in the end: tests leave observations out, and take others in again."""
    if datum.free:
        return datum
    seen = np.isin(problem.ties + np.arange(len(problem.surveyed)), result.rays.point[result.used])
    control = int((seen & result.network.point_weight[problem.ties :].any(axis=1)).sum())
    positions = int(result.network.centre_weight.any(axis=1).sum())
    return replace(datum, sentence=datum_sentence(positions, control, datum.basis))


def explained_datum(datum: Datum, tested: Tested, caused: bool) -> Datum:
    """The datum without its misfit before the adjustment, where a camera constant that was replaced explains it, or a cause
    that the sources show."""
    if not caused and not any(isinstance(finding, ConstantContradicted) and not finding.fixed for finding in tested.findings):
        return datum
    return replace(datum, findings=tuple(finding for finding in datum.findings if not isinstance(finding, DatumMisfit)))
