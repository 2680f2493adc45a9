"""Outputs that show little or nothing of the surface, in sentences: what, where, what to do."""

from collections.abc import Iterator, Sequence

from orthomill.schemas.solid.census import MeshCensus
from orthomill.tasks.colouring.report.colour_words import MORE_SIDES
from orthomill.tasks.projection.report.output_totals import OutputTotals

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
        elif total.facts.only:
            # Holes were asked for: they are what such an orthoimage is to show.
            if not total.coloured:
                yield f"{total.facts.only} sees nothing of the surface in '{total.name}', which is empty. Name another photograph."
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
        return f"Only {shown} of the surface in '{total.name}' is seen by a photograph; the rest stays empty. {MORE_SIDES}"
    seen = f"at most {before:.0f} degrees from its front" if before > 0 else f"from its back, by {-before:.0f} degrees and more"
    return (
        f"The plane of '{total.name}' is seen edge-on, {seen}: only {shown} of its surface has a colour. Turn its normal towards "
        "the photographs, or take photographs from its front."
    )
