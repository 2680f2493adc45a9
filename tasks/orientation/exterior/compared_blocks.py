"""Which of two blocks of the same photographs explains them better."""

import numpy as np

from orthomill.schemas.findings.contradiction_findings import OffsetAdjusted
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.orientation.block.assembly import BlockResults
from orthomill.tasks.orientation.block.own_constants import clearly_less

REJECTED = 4.0
"""Residual, in standard errors of a coordinate, from which on a measurement is as good as rejected where two blocks are compared"""


def explains_more(second: BlockResults, first: BlockResults) -> bool:
    """Whether a block explains the photographs better than another: more of them, or the same number with a smaller sum of squares
    of all residuals, in one unit, each no larger than one that is rejected."""
    photos, unit = [len(one.problem.names) for one in (second, first)], min(second.result.sigma0_px, first.result.sigma0_px)
    # Rays that a block does not use are not explained: the number of used ones alone would favour a block that bends to them.
    missed = [_missed(one.result, unit) for one in (second, first)]
    return (photos[0], missed[1]) > (photos[1], missed[0])


def _missed(result: Adjustment, unit: float) -> float:
    """The sum of the truncated squares of the residuals in `unit` px, less that of rays that are all rejected."""
    size = np.linalg.norm(result.residual[result.used], axis=1) / unit
    return float((np.minimum(size, REJECTED) ** 2 - REJECTED**2).sum())


def explains_clearly_more(second: BlockResults, first: BlockResults) -> bool:
    """The same, by more than chance and errors that neighbouring rays share; more photographs always do."""
    if len(second.problem.names) != len(first.problem.names):
        return len(second.problem.names) > len(first.problem.names)
    unit = min(second.result.sigma0_px, first.result.sigma0_px)
    missed, before = (_missed(one.result, unit) for one in (second, first))
    return explains_more(second, first) and clearly_less(missed, before, first.result)


def moved_positions(block: BlockResults) -> int:
    """How many groups of positions a block contradicts by more than their stated standard errors, each by a constant offset."""
    return sum(isinstance(finding, OffsetAdjusted) and not finding.as_stated for finding in block.findings)
