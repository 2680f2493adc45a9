"""What speaks against a block that another program has oriented: positions that lie elsewhere, tie points that do not fit it."""

import numpy as np

from orthomill.schemas.findings.foreign_findings import BlockElsewhere, TiePointsMisfit
from orthomill.schemas.orientation import GroundResidual

FAR = 5.0
"""Positions contradict the block where the median of their largest components, in standard errors, exceeds this: half of them are
that far off, which single blunders do not cause."""
LOOSE = 5.0
"""Tie points with an estimated standard error so many times the stated one do not belong to the orientation: a rough calibration
alone makes them two or three times worse."""


def elsewhere(positions: list[GroundResidual], source: str) -> tuple[BlockElsewhere, ...]:
    """Whether the block from `source` puts its photographs elsewhere than their positions say."""
    if not positions:
        return ()
    difference, sigma = (np.array([getattr(row, name) for row in positions]) for name in ("difference", "predicted"))
    # By component and not by length: heights in another system contradict by Z alone.
    if np.median(np.abs(difference / sigma).max(axis=1)) < FAR:
        return ()
    x, y, z = map(float, np.median(difference, axis=0))
    return (BlockElsewhere(source=source, offset=(x, y, z)),)


def tie_points_misfit(rms_px: float, factor: float, source: str) -> tuple[TiePointsMisfit, ...]:
    """Whether tie points, `rms_px` off and `factor` times worse than stated, do not fit the orientation from `source`."""
    return () if factor < LOOSE else (TiePointsMisfit(source=source, rms_px=rms_px, factor=factor),)


def rays_that_do_not_meet(tie_points: int, source: str) -> str:
    """The error where tie points exist but hardly any of them lies in front of its photographs."""
    return (
        f"The rays of the {tie_points} tie points do not meet in front of the photographs as {source} orients them: its angles or "
        "axes follow another convention (omega, phi, kappa in degrees, R = R3(kappa) R2(phi) R1(omega), world to image), or it is "
        "the block of other photographs. Convert the angles, or read the block of these photographs."
    )
