"""What speaks against a block that another program has oriented: positions that lie elsewhere, tie points that do not fit it."""

import numpy as np

from orthomill.schemas.orientation import GroundResidual

_FAR = 5.0
"""Positions that the block misses by more of their standard errors, half of them or more, contradict it."""
_LOOSE = 5.0
"""Tie points that miss the orientation by more of their own standard errors do not belong to it."""


def elsewhere(positions: list[GroundResidual], described: str) -> tuple[str, ...]:
    """A sentence when the block puts its photographs elsewhere than their positions say."""
    if not positions:
        return ()
    difference, sigma = (np.array([getattr(row, name) for row in positions]) for name in ("difference", "predicted"))
    if np.median(np.abs(difference / sigma).max(axis=1)) < _FAR:
        return ()
    off = np.median(difference, axis=0)
    return (
        f"The block that was read from {described} puts its photographs elsewhere than their positions do (median: "
        f"{off[0]:+.1f}, {off[1]:+.1f}, {off[2]:+.1f} m in X, Y, Z): its coordinates are in another reference or height system "
        "than the project, or the positions are of another place.",
    )


def unfitting(rms_px: float, factor: float, described: str) -> tuple[str, ...]:
    """A sentence when tie points, `rms_px` off and `factor` times worse than stated, do not fit the orientation."""
    if factor < _LOOSE:
        return ()
    return (
        f"The own tie points miss the orientation that was read from {described} by {rms_px:.1f} px, {factor:.0f} times their "
        "standard errors: it is not that of these photographs and cameras. Look for another order or unit of the angles, other "
        "axes, a camera of other pixels, or photographs under wrong names; or let the photographs be oriented here (exterior: "
        "{kind: adjusted}).",
    )


def unexamined(described: str) -> str:
    """What to say when the workflow has no tie points."""
    return (
        f"No own tie points examine the orientation that was read from {described}: with the stage tie_points in the workflow the "
        "report would tell how well it fits."
    )


def rays_that_do_not_meet(tie_points: int, described: str) -> str:
    """What to say when tie points exist but hardly any of them lies before its photographs."""
    return (
        f"The rays of the {tie_points} tie points do not meet before the photographs as {described} orients them: its angles or "
        "axes follow another convention (omega, phi, kappa in degrees, R = R3(kappa) R2(phi) R1(omega), world to image), or it is "
        "the block of other photographs."
    )
