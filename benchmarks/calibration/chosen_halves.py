"""Random halves of sets of boards, each calibrated as a user has it: `python -m benchmarks chosen_halves FOLDER:COLUMNSxROWS ...`.

Every half finds its own lens, by its own held-out photographs, and states its standard errors with the doubt of that choice. Ten
times a set is cut into two random halves: how far c, x0 and y0 of both differ, in the standard error of the difference. Two halves
need eight boards each, and sets of fewer are refused. The corners are those of every whole board that orthomill finds.
"""

from pathlib import Path

import numpy as np

from benchmarks.calibration.lens_choice import CHECKED, HALVES, boards_of, images_of
from benchmarks.instrument.result_page import write_page
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.lens_doubt import doubted
from orthomill.tasks.calibration.solving.lens_models import MODELS, WIDE_MODELS, with_affinity
from orthomill.tasks.calibration.solving.model_choice import choice, compare, sensible_corners
from orthomill.tasks.calibration.solving.solving import CalibrationTarget

_FEWEST = 16
"""boards of a set"""


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


def main(words: list[str]) -> None:
    """Write the page of the sets that are named."""
    rows = []
    for word in words:
        folder, _, size = word.rpartition(":")
        columns, lines = map(int, size.split("x"))
        rows.append(row(Path(folder).name, Path(folder), (columns, lines)))
        print(rows[-1], flush=True)
    about = (__doc__ or "").split("\n\n")[1].replace("\n", " ").strip()
    head = "| set | whole boards | lenses chosen, parameters | within 1 / 2 / 3, % | of c alone, 1 / 2 | median |"
    page = ["# Halves of sets of boards, each with the lens it chooses", "", about, "", "Due: 68 / 95 / 99.7 %, median 0.67.", ""]
    write_page("chosen_halves", words, "\n".join([*page, head, "| --- " * 6 + "|", *rows, ""]))
