"""What the measured heights of a surface have in common, against the truth: a volume over large ground rests on nothing else.

    python -m benchmarks common_errors FOLDER [RUN ...]

FOLDER is one of `python -m benchmarks surveyed_flights`; a RUN is a finished run of a simulated town. The errors of heights that
photographs measured, without what the orientations do to them, are divided by the standard errors that are stated for them among
neighbours: mean by mean, as in the volume over all of it. The quotient would be 0 if errors far apart were independent, and its
square is the correlation that they have. Flights differ in town, camera, lens and layout, so each is a draw of its own.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.volume_errors import Town, town_of
from benchmarks.instrument.result_page import write_page
from orthomill.tasks.accuracy.answers.error_correlation import COMMON

FARTHEST = 5.0
"""standard errors beyond which an error is left out: a blunder is none of what heights have in common"""


class CommonError(NamedTuple):
    """Of a surface: its name, the level of its datum in error, m, and the means of the errors of measured heights apart from it and
    of the standard errors that are stated for them, m."""

    name: str
    datum: float
    mean: float
    stated: float

    @property
    def ratio(self) -> float:
        """The mean error in stated ones."""
        return self.mean / self.stated


def common_error(name: str, town: Town) -> CommonError:
    """What measured heights of a town have in common."""
    own = np.where(town.whole.measured, town.wrong - town.turned, np.nan)
    known = np.isfinite(own) & np.isfinite(town.whole.relative)
    own, stated = own[known], town.whole.relative[known]
    kept = np.abs(own) <= FARTHEST * stated
    return CommonError(name, float(np.nanmean(town.turned)), float(own[kept].mean()), float(stated[kept].mean()))


def _towns(words: list[str]) -> list[CommonError]:
    found = []
    for word in map(Path, words):
        flights = sorted(word.glob("runs/flight_*_truth"))
        for flown in flights:
            name = flown.name.removesuffix("_truth")
            found.append(common_error(name, town_of(str(flown.with_name(name)), flown)))
        if not flights:
            found.append(common_error(word.name, town_of(str(word))))
    return found


def main(words: list[str]) -> None:
    """The page."""
    found = _towns(words or ["runs/surveyed_flights"])
    ratios = np.array([one.ratio for one in found])
    lines = ["# What measured heights have in common", ""]
    lines += ["| surface | datum mm | mean error mm | mean standard error mm | quotient |", "| --- | --- | --- | --- | --- |"]
    lines += [
        f"| {one.name} | {1000 * one.datum:+.0f} | {1000 * one.mean:+.1f} | {1000 * one.stated:.0f} | {one.ratio:+.2f} |"
        for one in found
    ]
    share = float(np.mean(ratios**2))
    lines += [
        "",
        f"Mean of the squares: {share:.3f}; `orthomill measure` assumes {COMMON:g}. {int((ratios**2 <= 4 * COMMON).sum())} of "
        f"{len(found)} lie within twice its root.",
        "The datum is what the block's orientations do to heights, by the true ones: stated apart, and taken out of the errors.",
        f"Errors beyond {FARTHEST:g} standard errors are left out.",
    ]
    write_page("common_errors", words, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
