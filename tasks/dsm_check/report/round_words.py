"""What the report says of a check in several rounds, of the shift of a surface from a file, and of the share that was judged."""

from collections.abc import Iterator
from math import hypot

from orthomill.schemas.stage_report import Evidence, Grid, Picture
from orthomill.schemas.surface import CHECK_CODES, CHECKED_CODE
from orthomill.tasks.dsm_check.areas import CoarseBlocks
from orthomill.tasks.dsm_check.judged_blocks import Values, corrections_rms
from orthomill.tasks.dsm_check.rounds.round_state import RoundState
from orthomill.tasks.dsm_check.statistics import RELIEF, TileCounts
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceShift

_SURE = 4.0
"""standard errors from which a shift is told as a fact"""
_OF_A_CELL = 0.25
"""cells: a shift in plan below it is no more than where in its cell a height is meant"""
_DATUM = 3.0
"""m: a shift in height beyond it is rather another height system than an error"""
_NO_DATUM = 200.0
"""m: no two height systems differ by so much; the sea lies 106 m below to 85 m above the ellipsoid"""


def shift_values(shift: SurfaceShift | None) -> Values:
    """Figures of the shift; None where the project checks its own surface."""
    if shift is None:
        return dict.fromkeys(("shift_up", "shift_up_sigma", "shift_east", "shift_north", "shift_plan_sigma"))
    plan = None if shift.plan_sigma is None else round(max(shift.plan_sigma), 3)
    east, north = (None if value is None else round(value, 3) for value in (shift.east, shift.north))
    return {
        "shift_up": round(shift.up, 3),
        "shift_up_sigma": round(shift.up_sigma, 4),
        "shift_east": east,
        "shift_north": north,
        "shift_plan_sigma": plan,
    }


def shift_warnings(shift: SurfaceShift, removed: bool, cell: float) -> Iterator[str]:
    """What is to be known of the place of a surface from a file. cell: m."""
    kept = "it was taken out" if removed else "the corrected surface keeps it, and all errors are given relative to it"
    if abs(shift.up) > _SURE * shift.up_sigma and shift.up_sigma > 0:
        side = "above" if shift.up > 0 else "below"
        datum = _cause(abs(shift.up))
        yield (
            f"The surface as a whole lies {abs(shift.up):.3f} m {side} the photographs (standard error {shift.up_sigma:.3f} "
            f"m){datum}; "
            f"{kept}."
        )
    if shift.east is None or shift.north is None or shift.plan_sigma is None:
        return
    if shift.in_plan and hypot(shift.east, shift.north) > _OF_A_CELL * cell:
        done = (
            "it was taken out" if removed else "it shows as errors of height on slopes and at edges (`shift: remove` takes it out)"
        )
        yield (
            f"The surface lies {abs(shift.east):.2f} m too far {'east' if shift.east > 0 else 'west'} and "
            f"{abs(shift.north):.2f} m too "
            f"far {'north' if shift.north > 0 else 'south'} (standard error {max(shift.plan_sigma):.2f} m); {done}."
        )


def _cause(up: float) -> str:
    """What a shift of so many metres is rather than an error of the surface."""
    if up > _NO_DATUM:
        return (
            "; no two height systems differ by so much: the photographs do not lie where their block says, or their camera "
            "constant is wrong (a nominal one from EXIF tags is an estimate), and then nothing here speaks of the surface"
        )
    if up > _DATUM:
        return "; so much is rather another height system, or a camera constant that does not fit the block, than an error"
    return ""


def check_evidence(coarse: CoarseBlocks, product: str) -> tuple[Evidence, ...]:
    """What the check says of the heights of the surface under test, a product of the project."""
    rms = corrections_rms(coarse)
    source = "by the check without reference data"
    return () if rms is None else (Evidence(of="height", rmse=rms, source=source, independent=False, products=(product,)),)


def rounds_grid(rounds: tuple[RoundState, ...]) -> tuple[Grid, ...]:
    """What every round did; nothing where there was one alone."""
    if len(rounds) < 2:
        return ()
    whole = sum(state.counts.total for state in rounds)
    rows, done = [], 0.0
    for number, state in enumerate(rounds, start=1):
        counts = state.counts
        done += counts.total
        rms = (counts.squares / counts.changed) ** 0.5 if counts.changed else None
        rows.append(
            (
                number,
                counts.judged,
                counts.changed,
                None if rms is None else round(rms, 3),
                round(100 * done / whole, 1) if whole else None,
                len(state.judged),
            )
        )
    return (
        Grid(
            title="Rounds of the check",
            columns=(
                "round",
                "cells judged",
                "cells corrected",
                "correction, RMS (m)",
                "of all corrections so far (%)",
                "tiles again",
            ),
            rows=tuple(rows),
            note="The first round judges everything, each later one the places that the one before corrected, more closely.",
        ),
    )


def _relief(tiles: tuple[TileCounts, ...]) -> list[tuple[int, int]]:
    """Measured cells and judged ones of every class of `RELIEF`."""
    every = [tile.relief for tile in tiles if tile.relief]
    return [(sum(one[k][0] for one in every), sum(one[k][1] for one in every)) for k in range(len(RELIEF))]


def relief_values(tiles: tuple[TileCounts, ...]) -> Values:
    """The share judged by class of the surface, %."""
    named = zip(("checked_level", "checked_steep", "checked_steps"), _relief(tiles), strict=True)
    return {name: round(100 * part / total, 2) if total else None for name, (total, part) in named}


def relief_grid(tiles: tuple[TileCounts, ...]) -> tuple[Grid, ...]:
    """The share judged by class of the surface."""
    totals = _relief(tiles)
    if not any(total for total, _ in totals):
        return ()
    return (
        Grid(
            title="Share judged by relief",
            columns=("surface", "measured cells", "judged (%)"),
            rows=tuple((name, n, round(100 * part / n, 1) if n else None) for name, (n, part) in zip(RELIEF, totals, strict=True)),
            note="By the slope across four cells. Beside walls one photograph of a pair sees what the other does not: more pairs "
            "per place (`pairs_per_place`) judge more.",
        ),
    )


def beyond_warning(tiles: tuple[TileCounts, ...], cell: float) -> Iterator[str]:
    """Large errors that could not be told exactly."""
    beyond = sum(tile.beyond for tile in tiles)
    if beyond:
        yield (
            f"Over {beyond * cell**2:.3g} m2 coarse orthoimages ask for large corrections that finer ones could not confirm: "
            "these heights are left as they are and marked (code 7); the error there may be beyond the reach of the check."
        )


def code_picture() -> Picture:
    """What the check says of every cell."""
    return Picture(
        title="What the check says",
        raster=CHECKED_CODE,
        style="classes",
        classes=CHECK_CODES,
        caption="The codes are those of the last band of dsm_check.tif.",
    )
