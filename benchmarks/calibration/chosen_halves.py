"""What cameras are worth whose lens was chosen: `python -m benchmarks chosen_halves [SEEDS] FOLDER:COLUMNSxROWS ...`.

Every half finds its own lens, by its own held-out photographs, and states its standard errors with the doubt of that choice. Ten
times a set is cut into two random halves: how far c, x0 and y0 of both differ, in the standard error of the difference. Two halves
need eight boards each, and sets of fewer are refused. The corners are those of every whole board that orthomill finds.

Of simulated boards the camera is known: c, x0 and y0 against the truth, of lenses with drawn coefficients of Brown's model, k3 and
decentring among them, in photographs of one board with 0.2 px of noise. No rule was chosen by them.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.calibration.board_setups import SIX_BOARDS, BoardSetup
from benchmarks.calibration.calibration_accuracy import corners_of
from benchmarks.calibration.lens_choice import CHECKED, HALVES, boards_of, images_of
from benchmarks.instrument.result_page import write_page
from orthomill.schemas.camera import BrownLens
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.lens_doubt import doubted
from orthomill.tasks.calibration.solving.lens_models import MODELS, WIDE_MODELS, with_affinity
from orthomill.tasks.calibration.solving.model_choice import choice, compare, sensible_corners
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.simulation.boards.board_scene import BoardType

_FEWEST = 16
"""boards of a set"""
_PHOTOGRAPHS = (5, 8, 16)
"""of a simulated set: too few to hold any out, as many as small sets have, and enough"""
_NOISE = 0.2
"""px"""
_SPREAD = {"k1": 0.1, "k2": 0.05, "k3": 0.02, "p1": 1e-4, "p2": 1e-4}
"""standard deviations of the coefficients that are drawn: decentring of good lenses, which few boards hardly show"""


def calibrated(boards: list[np.ndarray], target: CalibrationTarget) -> tuple[BoardAdjustment, str]:
    """The calibration of some boards with the lens that they choose, and what that is called."""
    known = arrangement_of(boards, target)
    judged = compare(known.result, known.start.corners, target, tuple(map(with_affinity, (*MODELS, *WIDE_MODELS))))
    chosen = choice({model: one.check for model, one in judged.items()})
    sensible = sensible_corners(one.result for one in judged.values())
    square = with_affinity(chosen, False)
    judged |= compare(judged[chosen].result, known.start.corners, target, (square,), sensible)
    chosen = choice({model: judged[model].check for model in (square, chosen)})
    return doubted(judged, chosen), f"{chosen.lens}, {len(chosen.free)}"


def differences(boards: list[np.ndarray], target: CalibrationTarget) -> tuple[np.ndarray, set[str]]:
    """(N, CHECKED): differences of halves in their standard errors; and the lenses that were chosen."""
    random, ratios, lenses = np.random.default_rng(1), [], set[str]()
    for _ in range(HALVES):
        order = random.permutation(len(boards))
        try:
            halves = [calibrated([boards[k] for k in np.sort(order[side::2])], target) for side in (0, 1)]
        except GeometryError:
            continue
        one, other = (result for result, _ in halves)
        variance = np.diag(one.interior_covariance + other.interior_covariance)[:CHECKED]
        ratios.append(np.abs(one.state.interior - other.state.interior)[:CHECKED] / np.sqrt(variance))
        lenses |= {lens for _, lens in halves}
    return np.array(ratios).reshape(-1, CHECKED), lenses


def row(name: str, folder: Path, corners: tuple[int, int]) -> str:
    """One line of the table."""
    seen = boards_of(images_of(folder), corners)
    if len(seen.whole) < _FEWEST:
        return f"| {name} | {len(seen.whole)} | too few for two halves | - | - | - |"
    ratios, lenses = differences(seen.whole, seen.target)
    shares = " / ".join(f"{100 * (ratios <= k).mean():.0f}" for k in (1, 2, 3))
    own = ", ".join(f"{100 * (ratios[:, 0] <= k).mean():.0f}" for k in (1, 2))
    return f"| {name} | {len(seen.whole)} | {'; '.join(sorted(lenses))} | {shares} | {own} | {np.median(ratios):.2f} |"


def simulated_set(photographs: int, seed: int) -> BoardSetup:
    """Photographs of one board with a lens of its own."""
    random = np.random.default_rng([77, seed])
    lens = BrownLens(**{name: float(random.normal(0.0, spread)) for name, spread in _SPREAD.items()})
    camera = SIX_BOARDS.camera.model_copy(update={"lens": lens})
    return replace(SIX_BOARDS, boards=1, board=BoardType((12, 9), 0.1, 0.02), photos=photographs, camera=camera, seed=5000 + seed)


def simulated_row(photographs: int, seeds: int) -> str:
    """One line of the table of simulated sets."""
    ratios, lenses = [], Counter[str]()
    for seed in range(seeds):
        setup = simulated_set(photographs, seed)
        corners = corners_of(setup, _NOISE, seed)
        result, lens = calibrated(corners.found, corners.target)
        error = (result.state.interior - np.array(setup.camera.interior))[:CHECKED]
        ratios.append(np.abs(error) / np.sqrt(np.diag(result.interior_covariance)[:CHECKED]))
        lenses[lens] += 1
    errors = np.array(ratios)
    shares = " / ".join(f"{100 * (errors <= k).mean():.0f}" for k in (1, 2, 3))
    chosen = "; ".join(f"{lens} ({count})" for lens, count in lenses.most_common())
    return f"| {photographs} | {seeds} | {chosen} | {shares} | {np.median(errors):.2f} | {errors.max():.1f} |"


def simulated(seeds: int) -> Iterator[str]:
    """The lines about simulated sets."""
    yield "| photographs | sets | lenses chosen, parameters (sets) | c, x0, y0 within 1 / 2 / 3, % | median | largest |"
    yield "| --- " * 6 + "|"
    for photographs in _PHOTOGRAPHS:
        yield simulated_row(photographs, seeds)
    yield ""


def main(words: list[str]) -> None:
    """Write the page of the sets that are named, and of as many simulated ones as a number says."""
    seeds = [int(word) for word in words if word.isdigit()]
    rows = []
    for word in (word for word in words if not word.isdigit()):
        folder, _, size = word.rpartition(":")
        columns, lines = map(int, size.split("x"))
        rows.append(row(Path(folder).name, Path(folder), (columns, lines)))
        print(rows[-1], flush=True)
    halves, known = (part.replace("\n", " ").strip() for part in (__doc__ or "").split("\n\n")[1:3])
    head = "| set | whole boards | lenses chosen, parameters | within 1 / 2 / 3, % | of c alone, 1 / 2 | median |"
    page = ["# Cameras whose lens was chosen, in their standard errors", "", "Due: 68 / 95 / 99.7 %, median 0.67.", ""]
    page += ["## Halves of photographed sets", "", halves, "", head, "| --- " * 6 + "|", *rows, ""] * bool(rows)
    page += ["## Simulated sets", "", known, "", *simulated(seeds[0])] if seeds else []
    write_page("chosen_halves", words, "\n".join(page))
