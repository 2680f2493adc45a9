"""The datum of photographs that belong together, and what their control contradicts before anything is adjusted."""

from dataclasses import replace

import numpy as np

from orthomill.schemas.findings.datum_findings import PointsExchanged
from orthomill.schemas.findings.observation_findings import ControlUnmet
from orthomill.tasks.adjustment.model.network import State
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices
from orthomill.tasks.orientation.start.exchanged_points import Exchanged, exchanged_points, without_exchanged
from orthomill.tasks.orientation.start.georeference import Datum, Known, choose_datum

UNMET = 2
"""Control points whose rays do not meet, by more than a wrong name"""


def datum_of_part(
    model: State,
    known: Known,
    choices: BlockChoices,
    vertical_sigma: float,
    names: tuple[str, ...],
    turned: bool,
    origin: np.ndarray | None,
) -> Datum:
    """The datum of a model. `vertical_sigma` rad; `names` (n,): of the surveyed points; `turned`: whether the tops of photographs
    are known; `origin` as in `choose_datum`."""
    exchanged = exchanged_points(model, known)
    believed = without_exchanged(known, exchanged) if exchanged else known
    datum = choose_datum(model, believed, vertical_sigma, choices.looking, choices.gnss_shift == "constant", origin)
    datum = _with_exchanged(datum, exchanged, names) if exchanged else datum
    # Half of them at least: single wrong names are found by the blunder tests, and named.
    if known.unmet >= UNMET and 2 * known.unmet > known.measured:
        unmet = ControlUnmet(points=known.unmet, measured=known.measured, turned=turned)
        datum = replace(datum, findings=(*datum.findings, unmet))
    return datum


def _with_exchanged(datum: Datum, exchanged: Exchanged, names: tuple[str, ...]) -> Datum:
    """The datum without two points that were exchanged, which are named."""
    numbers = [exchanged.first, exchanged.second]
    first, second = (names[number] for number in numbers)
    finding = PointsExchanged(first=first, second=second, exchanged_m=exchanged.exchanged_m, given_m=exchanged.given_m)
    aside = datum.control_aside.copy()
    aside[numbers] = True
    return replace(datum, control_aside=aside, findings=(finding, *datum.findings))
