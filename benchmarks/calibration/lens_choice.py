"""Lens models on real photographs of one board: held out on all corners beside OpenCV, and random halves against their errors.

Run with `python -m benchmarks.calibration.lens_choice FOLDER:COLUMNSxROWS ...`; prints a Markdown table.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares

from orthomill.schemas.project import CameraFromChessboards
from orthomill.tasks.calibration.detection.board_photographs import photo_corners
from orthomill.tasks.calibration.solving.arranging import arrangement_of, found_boards
from orthomill.tasks.calibration.solving.lens_models import MODELS, WIDE_MODELS, with_affinity
from orthomill.tasks.calibration.solving.model_choice import choice, compare, half_of
from orthomill.tasks.calibration.solving.solving import CalibrationTarget

HALVES = 8
CHECKED = 3
"""c, x0 and y0 are compared between halves."""


def boards_of(folder: Path, corners: tuple[int, int]) -> tuple[CalibrationTarget, list[np.ndarray]]:
    """The target, and every whole board (1, N, 2)."""
    tables = []
    for path in sorted(folder.iterdir()):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        tables.append(photo_corners(image[:, :, None], path.stem, corners, 1).corners)
    bend = CameraFromChessboards.model_fields["bend"].default
    target = CalibrationTarget(image.shape[::-1], corners, 0.03, 1, bend=bend)
    return target, [own for own in found_boards(tuple(tables), target) if len(own) and np.isfinite(own).all()]


def opencv_held_out(target: CalibrationTarget, boards: list[np.ndarray], flags: int) -> float:
    """px: root mean square of all corners, each half by the calibration of the other."""
    solid = np.column_stack([target.local, np.zeros(len(target.local))]).astype(np.float32)
    points = [target.pixels(own[0]).astype(np.float32) for own in boards]
    squares = []
    for half in (0, 1):
        own = points[half::2]
        _, matrix, lens, *_ = cv2.calibrateCamera([solid] * len(own), own, target.size, None, None, flags=flags)
        for board in points[1 - half :: 2]:
            _, turn, shift = cv2.solvePnP(solid, board, matrix, lens)

            def missed(pose: np.ndarray, board=board, matrix=matrix, lens=lens) -> np.ndarray:
                return (cv2.projectPoints(solid, pose[:3], pose[3:], matrix, lens)[0].reshape(-1, 2) - board).ravel()

            pose = least_squares(missed, np.append(turn, shift), method="lm").x
            squares.append((missed(pose).reshape(-1, 2) ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(squares).mean()))


def row(name: str, target: CalibrationTarget, boards: list[np.ndarray]) -> str:
    """One line of the table."""
    known = arrangement_of(boards, target)
    models = tuple(map(with_affinity, (*MODELS, *WIDE_MODELS)))
    judged = compare(known.result, known.start.corners, target, models)
    chosen = choice({model: one.check for model, one in judged.items()})
    result, check = judged[chosen].result, judged[chosen].check
    random, ratios = np.random.default_rng(1), []
    for _ in range(HALVES):
        photos = random.permutation(len(boards))
        one, other = (half_of(result, np.sort(photos[side::2])) for side in (0, 1))
        variance = np.diag(one.interior_covariance + other.interior_covariance)[:CHECKED]
        ratios.append(np.abs(one.state.interior - other.state.interior)[:CHECKED] / np.sqrt(variance))
    peers = [opencv_held_out(target, boards, flags) for flags in (0, cv2.CALIB_RATIONAL_MODEL)]
    return (
        f"| {name} | {len(boards)} | {chosen.lens}, {len(chosen.free)} | {check.rms_all:.4f} | {peers[0]:.4f} | {peers[1]:.4f} | "
        f"{result.correlated:.1f} | {np.mean(np.array(ratios) < 2.0):.0%} |"
    )


if __name__ == "__main__":
    print("| set | boards | model, parameters | held out, all (px) | OpenCV | OpenCV rational | factor | halves within 2 |")
    print("| --- " * 8 + "|")
    for argument in sys.argv[1:]:
        place, _, size = argument.rpartition(":")
        columns, rows = map(int, size.split("x"))
        print(row(Path(place).name, *boards_of(Path(place), (columns, rows))), flush=True)
