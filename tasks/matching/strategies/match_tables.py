"""Matches as tables: rows selected, replaced, moved, rejected. All return new tables and do not change their arguments."""

import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.least_squares.matching import Matches


def moved(found: Matches, left: np.ndarray, right: np.ndarray) -> Matches:
    """The same matches with their positions moved by (col, row) in the left and in the right image."""
    return Matches(
        **{**found.__dict__, "col": found.col + right[0], "row": found.row + right[1], "reference": found.reference + left}
    )


def merged(old: Matches, new: Matches, rows: np.ndarray) -> Matches:
    """`old` with its rows (bool or int) replaced by those of `new`."""
    tables = {}
    for name, table in old.__dict__.items():
        # A copy: callers keep the earlier table to compare with.
        tables[name] = table.copy()
        tables[name][rows] = new.__dict__[name]
    return Matches(**tables)


def taken(matches: Matches, rows: np.ndarray) -> Matches:
    """Some rows of matches."""
    return Matches(**{name: table[rows] for name, table in matches.__dict__.items()})


def rejected(matches: Matches, rows: np.ndarray, outcome: Outcome) -> Matches:
    """The same with another outcome, and without position and precision, in some rows (bool)."""
    new = taken(matches, rows)
    # Correlation, affine and sigma0 stay: they show why the attempt was rejected.
    blank = {name: np.full_like(new.__dict__[name], np.nan) for name in ("col", "row", "covariance")}
    return merged(matches, Matches(**{**new.__dict__, **blank, "outcome": np.full(len(new), outcome, np.uint8)}), rows)
