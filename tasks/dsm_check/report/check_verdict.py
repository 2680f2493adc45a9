"""What a check is worth, and what it answers: agreement, and beside it what would have been found and what could not be seen.

Agreement alone earns no "good": a surface may agree because nothing better could have been found. Good is one whose corrections are
no larger than the noise of the check, of which few cells were changed, and, where the survey names a tolerance, most is proved.
"""

import math
from dataclasses import dataclass

from orthomill.schemas.stage_report import Answer, Topic, Verdict
from orthomill.tasks.dsm_check.difference_words import CHANGES, AreaWords
from orthomill.tasks.dsm_check.judged_blocks import Values
from orthomill.tasks.dsm_check.statistics import Summary, TileCounts

_SEEN = 0.95
"""share of the heights that two photographs show below which it is told"""
_LEAST = 0.5
"""share of the heights that must have been judged"""
_NOISE = 0.5
"""of the smallest error that is found: a robust spread beyond it is no noise of the check"""
_CHANGED = 0.1
"""share of the judged heights beyond doubt wrong, above which a surface does not agree with the photographs"""
_PROVED = 95.0
"""% of the judged ground that must keep the tolerance"""


@dataclass(frozen=True)
class CheckSight:
    """What the check can see: the smallest error that it finds (m, NaN if none), from which width (m) on, and one pixel of height
    (m); the shares of a tolerance, and its size (m), where the survey names one."""

    detectable: float
    wide: float | None
    pixel_height: float
    tolerance: float | None
    kept: Values


def percent(part: int, of: int) -> float:
    """A part of a number, to 0.01 %; 0 of nothing."""
    return round(100 * part / max(of, 1), 2)


def check_verdict(tiles: tuple[TileCounts, ...], whole: Summary, sight: CheckSight, words: AreaWords) -> Verdict:
    """The verdict of a check, in one sentence."""
    heights, checked = sum(tile.heights for tile in tiles), sum(tile.checked for tile in tiles)
    if not whole.number:
        return Verdict(level="fair", sentence="Nothing of the surface could be checked against the photographs.", weighs=True)
    said = (
        f"Photographs and surface agree to {whole.nmad:.2g} m (robust spread) where it could be checked, which is "
        f"{percent(checked, heights):.0f} % of the measured heights"
    )
    shown = sum(tile.shown for tile in tiles)
    if 0 < shown < _SEEN * heights:
        said += f" ({min(percent(checked, shown), 100.0):.0f} % of those that two photographs show)"
    if math.isfinite(sight.detectable):
        width = f", {sight.wide:.2g} m wide or more," if sight.wide else ""
        said += (
            f"; there {words.one} of {sight.detectable:.2g} m{width} would have been found: of smaller and narrower ones, and of "
            "what surface and photographs share, it tells nothing"
        )
    if sight.tolerance is not None and sight.kept["proved"] is not None:
        said += (
            f". {sight.tolerance:g} m are allowed: {sight.kept['proved']:.0f} % of the judged ground is proved to keep that, "
            f"{sight.kept['broken']:.0f} % breaks it, {sight.kept['untold']:.0f} % is undecided"
        )
    enough = checked >= _LEAST * heights
    good = enough and (words is CHANGES or _agrees(tiles, whole, sight))
    return Verdict(level="good" if good else "fair", sentence=f"{said}.", weighs=True)


def _agrees(tiles: tuple[TileCounts, ...], whole: Summary, sight: CheckSight) -> bool:
    limit = min(sight.pixel_height, _NOISE * sight.detectable if math.isfinite(sight.detectable) else 0.0)
    changed, checked = sum(tile.changed for tile in tiles), sum(tile.checked for tile in tiles)
    proved = sight.kept["proved"]
    return whole.nmad <= limit and changed <= _CHANGED * checked and (proved is None or proved >= _PROVED)


def check_answer(tiles: tuple[TileCounts, ...], whole: Summary, areas: int, sight: CheckSight) -> Answer:
    """What the check says to somebody who has asked for nothing else."""
    if not whole.number:
        return Answer(topic=Topic.CHECK, text="nothing could be checked")
    share = percent(sum(tile.checked for tile in tiles), sum(tile.heights for tile in tiles))
    look = f"{areas} areas to look at" if areas > 1 else "one area to look at" if areas else "no area stands out"
    blind = f"; errors below {sight.detectable:.2g} m are not seen" if math.isfinite(sight.detectable) else ""
    return Answer(
        topic=Topic.CHECK, text=f"agree to {whole.nmad:.2g} m (robust spread) at {share:.0f} % of the heights; {look}{blind}"
    )
