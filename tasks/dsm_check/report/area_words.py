"""How areas where photographs and surface disagree are told: errors of a surface of the same time, changes since an earlier one."""

import math
from collections.abc import Iterator

from orthomill.schemas.stage_report import Grid
from orthomill.tasks.dsm_check.areas import SuspiciousArea, Trend
from orthomill.tasks.dsm_check.difference_words import AreaWords

_LISTED = 20
"""areas in the table"""
_WARNED = 3
"""areas in the warning"""


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
