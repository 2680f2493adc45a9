"""Whether accuracies and classes that are stated from 20 check points hold: many draws of points on a simulated town's surface.

Each draw surveys 20 places with errors of 20 mm, tests the surface there as the stage does, and states; the truth is the root mean
square of the surface's errors at all such places. Then the same with a dome, a tilt, a shift and a scale planted.
"""

import math
import sys
from pathlib import Path

import numpy as np

from benchmarks.accuracy.true_errors import errors_of
from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.cli.lookups.measured_surface import RunSurface
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.accuracy.accuracy_statement import AccuracyFigure, class_of
from orthomill.schemas.surface import DATUM_PRECISION, HEIGHT, PRECISION, PROVENANCE
from orthomill.tasks.accuracy.points.surface_height import CellsAround, cells_around, height_at
from orthomill.tasks.accuracy.statement.named_errors import named_errors
from orthomill.tasks.accuracy.statement.tested_accuracy import accuracy_of

PLACES, DRAWS, POINTS = 3000, 1000, 20
SURVEY = 0.02
"""m"""
GROSS = 10.0
"""promised errors: beyond it a height is a blunder, of which no root mean square of a few points tells"""

EVEN = 1.5
"""times the median promised error: the few places beyond it have half of the mean square, and 20 points hardly ever meet them"""


def tested_places(run: Path, truth: Path | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places (N, 2) m where heights can be tested, their errors (N,) m, what the surface promises (N,) m, and the part of it
    that is the place of the block (N,) m; truth: the run that simulated the photographs, where it is another one."""
    store, grid, rng = Store(run), RunSurface(run).grid, np.random.default_rng(1)
    whole = [store.read(name, store.spec(name).full) for name in (HEIGHT, PRECISION, PROVENANCE, DATUM_PRECISION)]
    # A pole stands on the ground, below leaves as well.
    wrong = errors_of(Store(truth) if truth else store, grid, whole[0])
    places, errors, promised, datum = [], [], [], []
    for _ in range(PLACES):
        row, col = rng.integers(8, grid.rows - 8), rng.integers(8, grid.cols - 8)
        # Just beside a cell's centre, where the truth of that cell holds.
        x, y = grid.west + (col + 0.501) * grid.cell, grid.north - (row + 0.501) * grid.cell
        window = cells_around(grid, x, y).clipped(grid.shape)
        parts = (raster[window.slices] for raster in whole)
        found = height_at(CellsAround(grid, window, *parts), x, y, 0.1)
        error = float(wrong[row, col])
        if found.tested and math.isfinite(error):
            places.append((x, y))
            errors.append(error)
            promised.append(found.sigma)
            datum.append(found.datum)
    return np.array(places), np.array(errors), np.array(promised), np.array(datum)


def drawn(errors: np.ndarray, promised: np.ndarray, rng: np.random.Generator) -> AccuracyFigure:
    """What 20 surveyed points state of a surface that promises these errors (N,) m."""
    chosen = rng.choice(len(errors), POINTS, replace=False)
    difference, survey = (errors[chosen] - rng.normal(0, SURVEY, POINTS))[:, None], np.full((POINTS, 1), SURVEY)
    surface = (root_mean_square(promised[chosen]), root_mean_square(promised))
    found = accuracy_of("nva", difference, survey, None, 1.0, surface)
    assert found
    return found


def root_mean_square(values: np.ndarray) -> float:
    """Of any numbers."""
    return math.sqrt(float((values**2).mean()))


def share(values: list[bool]) -> str:
    """In percent."""
    return f"{100 * float(np.mean(values)):.1f}"


def statement_row(name: str, errors: np.ndarray, promised: np.ndarray) -> str:
    """Many statements against the truth."""
    rng = np.random.default_rng(2)
    # The standard adds the survey's error to what is found, in which it is already once.
    truth = math.sqrt(float((errors**2).mean()) + 2 * SURVEY**2)
    found = [drawn(errors, promised, rng) for _ in range(DRAWS)]
    held = [one.low <= truth <= (one.high or math.inf) for one in found]
    ranged = [class_of(one.low) <= class_of(truth) <= (one.proved_cm or math.inf) for one in found]
    better = [(one.proved_cm or math.inf) < class_of(truth) for one in found]
    plain = [one.class_cm < class_of(truth) for one in found]
    right = [one.class_cm == class_of(truth) for one in found]
    best = ceiling(truth, POINTS)
    start = f"| {name} | {1000 * truth:.0f} | {share(held)} | {share(ranged)} | {share(better)}"
    return f"{start} | {share(right)} | {best:.1f} | {share(plain)} |"


def ceiling(truth: float, points: int) -> float:
    """The share (%) of draws of so many points in which the most probable class is the right one, for somebody who knows that the
    errors are normal and nothing else; the `truth` (m) may lie anywhere within its class. No method states more of them rightly.
    """
    rng, cm = np.random.default_rng(5), class_of(truth)
    asked = rng.uniform(cm - 1, cm, DRAWS)
    found = asked * np.sqrt(rng.chisquare(points, DRAWS) / points)
    tried = np.arange(0.05, 3 * cm, 0.1)
    # The density of what was found for every truth that it may come from, all of them as likely.
    square = points * (found[:, None] / tried) ** 2
    power = 0.5 * points * np.log(square) - square / 2
    density = np.exp(power - power.max(axis=1, keepdims=True))
    classes = np.ceil(tried).astype(np.int64)
    weight = np.stack([density[:, classes == k].sum(axis=1) for k in range(1, classes[-1] + 1)], axis=1)
    return 100 * float((weight.argmax(axis=1) + 1 == cm).mean())


def planted(places: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Errors in height (N,) and in plan (N, 2), m, by name."""
    unit = (places - places.mean(axis=0)) / (np.ptp(places, axis=0).max() / 2)
    none, flat = np.zeros(len(places)), np.zeros(places.shape)
    return {
        "dome": (-1.3 * (unit**2).sum(axis=1), flat),
        "tilt": (0.5 * unit[:, 0], flat),
        "shift_up": (none + 0.3, flat),
        "shift_plan": (none, flat + 0.3),
        "scale": (none, 5e-4 * (places - places.mean(axis=0))),
        "none": (none, flat),
    }


def named_row(
    kind: str, places: np.ndarray, errors: np.ndarray, wrong: tuple[np.ndarray, np.ndarray], datum: np.ndarray, mixed: bool = False
) -> str:
    """How often the largest error that is named is the planted one, and how often one is beyond what the block promises; mixed: the
    surface's own errors change places, so that nothing is shared but by chance."""
    rng, first, doubted = np.random.default_rng(3), [], []
    for _ in range(300):
        chosen = rng.choice(len(places), POINTS, replace=False)
        own = rng.permutation(errors)[chosen] if mixed else errors[chosen]
        height = own + wrong[0][chosen] - rng.normal(0, SURVEY, POINTS)
        plan = wrong[1][chosen] - rng.normal(0, SURVEY, (POINTS, 2))
        survey, promised = (SURVEY, SURVEY), (None, math.sqrt(float((datum[chosen] ** 2).mean())))
        named = named_errors(places[chosen], height, plan, survey, promised)
        first.append(named[0].kind if named else "none")
        doubted.append(any(not error.is_promised for error in named))
    words = f"{kind}, errors mixed" if mixed else kind
    return f"| {words} | {share([one == kind for one in first])} | {share(doubted)} | {', '.join(sorted(set(first)))} |"


def shared_by_all(places: np.ndarray, errors: np.ndarray, datum: np.ndarray) -> str:
    """What the surface's own errors share by all places where it can be tested."""
    named = named_errors(places, errors, np.full(places.shape, np.nan), promised=(None, math.sqrt(float((datum**2).mean()))))
    return f"By all {len(places)} places the surface as it is: {' '.join(e.sentence for e in named) or 'nothing is shared.'}"


_HEAD = (
    "| surface | truth by the standard mm | interval holds truth (%) | class range holds truth (%) | proved class better (%) "
    "| plain class right (%) | ceiling (%) | plain class better (%) |"
)


def main(words: list[str]) -> None:
    """The page."""
    lines = ["# Accuracies and classes stated from 20 check points", "", _HEAD, "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    names: list[str] = []
    for run in words or ["runs/volos"]:
        places, errors, promised, datum = tested_places(Path(run))
        name, gross = Path(run).name, np.abs(errors) > GROSS * promised
        if gross.any():
            # One error of metres in two thousand places makes the root mean square, and twenty points hardly ever meet it.
            worst = float(np.abs(errors).max())
            lines.append(statement_row(f"{name}, with {gross.sum()} gross errors (to {worst:.1f} m)", errors, promised))
        places, errors, promised, datum = (values[~gross] for values in (places, errors, promised, datum))
        ratio = math.sqrt(float(((errors / promised) ** 2).mean()))
        lines.append(statement_row(f"{name} ({len(places)} places; errors {ratio:.2f} of promised)", errors, promised))
        even = promised <= EVEN * np.median(promised)
        told = f"{name}, {share(list(even))} % of its places, where at most {EVEN:g} times the median error is promised"
        lines.append(statement_row(told, errors[even], promised[even]))
        lines.append(statement_row(f"{name} domed by 1.3 m", errors + planted(places)["dome"][0], promised))
        names += [named_row(kind, places, errors, wrong, datum) for kind, wrong in planted(places).items()]
        # Without its mean, which mixing leaves.
        names.append(named_row("none", places, errors - errors.mean(), planted(places)["none"], datum, mixed=True))
        names += ["", shared_by_all(places, errors, datum)]
    lines += [
        "",
        f"{DRAWS} draws of {POINTS} points surveyed to {1000 * SURVEY:.0f} mm, on ground where heights are tested. Class range:",
        "from the class of the interval's lower end to the proved class. Plain class: by the standard's formula alone.",
        f"Gross errors, beyond {GROSS:g} promised errors, stand in a row of their own: so few points do not meet them.",
        f"Ceiling: how often the most probable class is the right one at best, from {POINTS} points with normal errors.",
        "",
        "## Planted errors, 300 draws each",
        "",
        "Doubted: an error is named that is beyond what the block promises of its place; others are told, and no reason to doubt.",
        "None: the surface as it is, whose block may lean; errors mixed: the same errors at other places, so that none is shared.",
        "",
        "| planted | named first (%) | doubted (%) | names that occurred |",
        "| --- | --- | --- | --- |",
        *names,
    ]
    write_page("stated_classes", words, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
