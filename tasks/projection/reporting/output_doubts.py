"""Outputs that show little or nothing of the surface, in sentences: what, where, what to do."""

from collections.abc import Iterator, Sequence

import numpy as np

from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.frames import AnyFrame, FlatFrame, Vector
from orthomill.tasks.projection.reporting.output_totals import OutputTotals

_BEHIND, _LITTLE = 0.5, 0.5
"""part of an output that shows backs; part with a colour below which it is worth a sentence"""
_EDGE_ON = 10.0
"""degrees below which photographs see a plane edge-on: its pixels are six times as long as wide for them"""


def output_doubts(census: MeshCensus, totals: Sequence[OutputTotals]) -> Iterator[str]:
    """A sentence for each output that is not worth looking at."""
    for total in totals:
        surface = total.sum("surface")
        if surface == 0:
            yield _nothing(census, total)
        elif total.sum("backs") > _BEHIND * surface:
            yield (
                f"{100 * total.sum('backs') / surface:.0f} % of the surface in '{total.name}' shows its back, which nothing is "
                "painted on: it is seen from inside or from behind. Move the position or turn the plane round."
            )
        elif total.coloured < _LITTLE:
            yield _uncoloured(total)


def _nothing(census: MeshCensus, total: OutputTotals) -> str:
    low, high = (", ".join(f"{value:.6g}" for value in corner) for corner in (census.low, census.high))
    reaches = f"the surface reaches from ({low}) to ({high})"
    if total.facts.cut:
        return (
            f"'{total.name}' shows no surface: its section removes all that would be in the picture; {reaches}. Move the section, "
            "or turn it round."
        )
    return f"'{total.name}' shows no surface: its plane, cylinder or view passes it by; {reaches}. Move it there."


def _uncoloured(total: OutputTotals) -> str:
    before, shown = total.facts.before, f"{100 * total.coloured:.0f} %"
    if before > _EDGE_ON:
        return (
            f"Only {shown} of the surface in '{total.name}' is seen by a photograph; the rest stays empty. Photographs from more "
            "sides would fill it."
        )
    seen = f"at most {before:.0f} degrees from its front" if before > 0 else f"from its back, by {-before:.0f} degrees and more"
    return (
        f"The plane of '{total.name}' is seen edge-on, {seen}: only {shown} of its surface has a colour. Turn its normal towards "
        "the photographs, or take photographs from its front."
    )


def degrees_before(frame: AnyFrame, centres: Sequence[Vector]) -> float:
    """By how many degrees projection centres stand before the plane of an output at most, seen from its middle and corners;
    90 for what is no plane."""
    if not isinstance(frame, FlatFrame):
        return 90.0
    corner, right, up, normal = (np.array(values) for values in (frame.corner, frame.right, frame.up, frame.normal))
    width, height = frame.cols * frame.pixel, frame.rows * frame.pixel
    shares = np.array([(0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)])
    places = corner + shares[:, :1] * width * right - shares[:, 1:] * height * up
    along = np.array(centres)[:, None] - places
    distance = np.linalg.norm(along, axis=2)
    return float(np.degrees(np.arcsin(np.clip((along @ normal) / np.maximum(distance, 1e-12), -1.0, 1.0))).max())
