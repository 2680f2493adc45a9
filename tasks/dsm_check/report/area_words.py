"""How areas where photographs and surface disagree are told: errors of a surface of the same time, changes since an earlier one."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.schemas.stage_report import Grid
from orthomill.tasks.dsm_check.areas import SuspiciousArea, Trend

_LISTED = 20
"""areas in the table"""
_WARNED = 3
"""areas in the warning"""


@dataclass(frozen=True)
class AreaWords:
    """What a difference is called: an error, a change; where photographs lie lower or higher than the surface."""

    one: str
    lower: str
    higher: str
    column: str
    title: str
    picture: str
    told: str

    def side(self, dh: float) -> str:
        """dh: m, what must be added to the surface."""
        return self.lower if dh < 0 else self.higher


ERRORS = AreaWords(
    one="an error",
    lower="too high",
    higher="too low",
    column="surface is",
    title="Suspicious areas",
    picture="Check of the surface",
    told="Photographs and surface disagree locally{relative}: the surface is {areas}. Look there in the photographs: "
    "dsm_check_areas.geojson has the outlines.",
)
CHANGES = AreaWords(
    one="a change",
    lower="fallen",
    higher="risen",
    column="ground has",
    title="Changed areas",
    picture="Change since the earlier surface",
    told="The ground has changed{relative}: {areas}. dsm_check_areas.geojson has the outlines; trees, vehicles and what was built "
    "are changes as well.",
)


def areas_grid(areas: list[SuspiciousArea], words: AreaWords) -> tuple[Grid, ...]:
    """The largest areas by volume; nothing where there are none."""
    if not areas:
        return ()
    rows = tuple(
        (round(a.x, 1), round(a.y, 1), round(a.area, 1), round(a.dh, 2), round(a.extreme, 2), words.side(a.dh))
        for a in areas[:_LISTED]
    )
    columns = ("X (m)", "Y (m)", "area (m2)", "mean correction (m)", "largest (m)", words.column)
    note = (
        f"The {len(rows)} largest of {len(areas)} by volume: inspect them first. Corrections are relative to the trend, a plane "
        "through the corrections of the whole surface that large areas do not move; products/dsm_check_areas.geojson has their "
        "outlines."
    )
    return (Grid(title=words.title, columns=columns, rows=rows, note=note),)


def area_warnings(areas: list[SuspiciousArea], trend: Trend, words: AreaWords) -> Iterator[str]:
    """The largest areas in one sentence."""
    if not areas:
        return
    named = "; ".join(
        f"{words.side(area.dh)} by about {abs(area.dh):.2g} m over {area.area:.2g} m2 at {_place(area)}" for area in areas[:_WARNED]
    )
    more = f"; {len(areas) - _WARNED} more areas are in the table" if len(areas) > _WARNED else ""
    # To the centimetre: a trend of a millimetre is none.
    flat = abs(trend.middle) < 0.005
    relative = "" if flat else f", relative to the trend of all corrections ({trend.middle:+.2f} m in the middle)"
    yield words.told.format(relative=relative, areas=f"{named}{more}")


def _place(area: SuspiciousArea) -> str:
    # To a tenth of its width or better: whole metres say nothing on a wall.
    digits = max(0, 1 - math.floor(math.log10(math.sqrt(area.area))))
    return f"X {area.x:.{digits}f}, Y {area.y:.{digits}f}"
