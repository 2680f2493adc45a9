"""The relative orientation of a pair of a finished run in the classical forms: as a table for people, or as JSON.

The catalogue provides the method; this file knows the folder of the run and how its answer is printed.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError
from orthomill.schemas.inspections.inspection import PairForms, PairUnknown
from orthomill.schemas.observations import TIE_POINTS, TiePoints
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, Photos

ClassicalForms = Callable[[Block, Photos, TiePoints, str, str], PairForms]
_HEAD = ("unknown", "", "from its tie points", "+-", "from the block", "+-", "difference / its standard error")


def pair_forms(folder: Path, left: str, right: str, classical_forms: ClassicalForms) -> PairForms:
    """The forms of a pair of a run. Raises StoreError before the run has a block or where it had no tie points."""
    store = Store(folder)
    if not (store.has_table(BLOCK) and store.has_table(TIE_POINTS)):
        raise StoreError(
            f"{folder.name} has no block with tie points yet; run it first: orthomill run {folder.name} --until orientation"
        )
    return classical_forms(store.table(BLOCK), store.table(PHOTOS), store.table(TIE_POINTS), left, right)


def as_json(forms: PairForms) -> str:
    """All figures under the names of the schema."""
    return json.dumps(asdict(forms), indent=2)


def relative_lines(forms: PairForms) -> Iterator[str]:
    """The lines of the terminal."""
    yield f"{forms.left} and {forms.right}: {forms.kept} of {forms.matches} tie points kept, sigma0 {forms.sigma0_px:.3f} px"
    if forms.failed_start:
        kept, sigma0 = forms.failed_start
        yield (
            f"The published procedure went wrong or left wrong matches in: sigma0 {sigma0:.2f} px, {kept} of {forms.matches} tie "
            "points kept. This is the solution from a start by five points."
        )
    if any(forms.quarter_turns):
        first, second = (90 * turn for turn in forms.quarter_turns)
        yield f"Image systems turned by {first} and {second} degrees, so that the base lies along x."
    rows = [_HEAD, *map(_row, forms.unknowns)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(_HEAD))]
    of_form = ("", *(unknown.form for unknown in forms.unknowns))
    for form, before, row in zip(of_form, ("", *of_form), rows, strict=False):
        if form and form != before:
            yield form
        yield "  " + "  ".join(
            cell.rjust(width) if k > 1 else cell.ljust(width) for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )


def _row(unknown: PairUnknown) -> tuple[str, ...]:
    own, derived = unknown.sigma_of_points, unknown.sigma_of_block
    spread = None if own is None or derived is None else (own**2 + derived**2) ** 0.5
    ratio = f"{(unknown.of_points - unknown.of_block) / spread:.1f}" if spread else "-"
    return (unknown.name, unknown.unit, f"{unknown.of_points:.5f}", _sigma(own), f"{unknown.of_block:.5f}", _sigma(derived), ratio)


def _sigma(value: float | None) -> str:
    return "-" if value is None else f"{value:.5f}"
