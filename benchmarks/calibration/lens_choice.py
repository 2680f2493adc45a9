"""Real photographs of one board that nobody here has taken: boards found, held out on all corners beside OpenCV, random halves.

`python -m benchmarks foreign_boards FOLDER:COLUMNSxROWS ...` writes benchmarks/results/foreign_boards.md, where rows of sets that
are not named are kept. The corners are the same for all: those of every whole board that orthomill finds.
The folders hold the photographs of public repositories; their names are those of SOURCES.
"""

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import least_squares

from benchmarks.instrument.result_page import RESULTS, write_page
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.project import CameraFromChessboards
from orthomill.tasks.calibration.detection.board_photographs import photo_corners
from orthomill.tasks.calibration.solving.arranging import arrangement_of, found_boards
from orthomill.tasks.calibration.solving.calibration_precision import largest_bend
from orthomill.tasks.calibration.solving.lens_models import MODELS, WIDE_MODELS, with_affinity
from orthomill.tasks.calibration.solving.model_choice import choice, compare, half_of
from orthomill.tasks.calibration.solving.solving import CalibrationTarget

PAGE = RESULTS / "foreign_boards.md"
HALVES = 10
CHECKED = 3
"""c, x0 and y0 are compared between halves."""
SQUARE = 0.03
"""m: nobody knows the squares of most sets, and pixels do not depend on them."""
SOURCES = {
    "carnd_gopro": "AndanteKim/CarND-Camera-Calibration, calibration_wide, 8 x 6",
    "carnd_lanes": "udacity/CarND-Advanced-Lane-Lines, camera_cal, 9 x 6",
    "sourishg_fisheye_left": "sourishg/fisheye-stereo-calibration, imgs/left*, 9 x 6 (and _right)",
    "sourishg_stereo_left": "sourishg/stereo-calibration, calib_imgs/2/left*, 9 x 6 (and _right)",
    "rig_left": "sourishg/stereo-calibration, calib_imgs/1/left*, 9 x 6 (and rig_right)",
    "xinning_fisheye": "XinningShen/Fisheye_Camera_Calibration, fisheye_chessboard_train_pic, 9 x 6",
    "opencv_left": "OpenCV's samples left*.jpg, 9 x 6 (and opencv_right)",
    "limhaeryong": "LimHaeryong/Camera-Calibration-using-Ceres-Solver, resources/checkerboard, 8 x 6",
    "ncc79601": "NCC79601/Fisheye-Camera-Calibration, images_pinhole, 9 x 6",
    "amoghesturi_a": "amoghesturi/Camera-Calibration, Calibration_Server/Data/Pics/imx6a, 9 x 6 (and _b)",
    "prozyr": "prozyr/Chessboard_Based_Camera_Calibration, images_smaller, 7 x 7",
    "niconielsen_industrial": "niconielsen32/ComputerVision, cameraCalibration/calibration, 24 x 17",
    "ginevracoal": "ginevracoal/zhang-camera-calibration, src/images, 13 x 12",
}
SUFFIXES = (".jpg", ".jpeg", ".png", ".tif")
HEAD = (
    "| set | photographs | boards, ours | OpenCV's | lens, parameters | held out, all (px) | OpenCV plain | rational | fisheye | "
    "bend (%) | factor | halves within 2 | CPU-s |"
)
Calibrated = tuple[np.ndarray, np.ndarray]


def images_of(folder: Path) -> list[np.ndarray]:
    """The photographs of a folder in grey; of several sizes the most frequent one."""
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    read = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]
    size = Counter(image.shape for image in read).most_common(1)[0][0]
    return [image for image in read if image.shape == size]


class Seen(NamedTuple):
    """The target, every whole board (1, N, 2), and in how many photographs we and OpenCV's best detector see one; ours may be
    cut."""

    target: CalibrationTarget
    whole: list[np.ndarray]
    ours: int
    peer: int

    @property
    def words(self) -> str:
        """How many of our boards there are, and how many are whole where not all are."""
        return str(self.ours) if self.ours == len(self.whole) else f"{self.ours} ({len(self.whole)} whole)"


def boards_of(images: list[np.ndarray], corners: tuple[int, int]) -> Seen:
    """The boards of all photographs."""
    tables = [photo_corners(image[:, :, None], str(number), corners, 1).corners for number, image in enumerate(images)]
    bend = CameraFromChessboards.model_fields["bend"].default
    target = CalibrationTarget(images[0].shape[::-1], corners, SQUARE, 1, bend=bend)
    whole = [own for own in found_boards(tuple(tables), target) if len(own) and np.isfinite(own).all()]
    flags = cv2.CALIB_CB_EXHAUSTIVE + cv2.CALIB_CB_ACCURACY
    peer = sum(cv2.findChessboardCornersSB(image, corners, flags=flags)[0] for image in images)
    return Seen(target, whole, sum(len(table) > 0 for table in tables), peer)


def _plain(flags: int) -> Callable[[np.ndarray, list[np.ndarray], tuple[int, int]], Calibrated]:
    def calibrated(solid: np.ndarray, points: list[np.ndarray], size: tuple[int, int]) -> Calibrated:
        return cv2.calibrateCamera([solid] * len(points), points, size, None, None, flags=flags)[1:3]

    return calibrated


def _fisheye(solid: np.ndarray, points: list[np.ndarray], size: tuple[int, int]) -> Calibrated:
    start = np.array([[size[0] / 3, 0, size[0] / 2], [0, size[0] / 3, size[1] / 2], [0, 0, 1.0]])
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC + cv2.CALIB_FIX_SKEW + cv2.CALIB_USE_INTRINSIC_GUESS
    own = [point.reshape(1, -1, 2).astype(np.float64) for point in points]
    boards = [solid.reshape(1, -1, 3).astype(np.float64)] * len(points)
    return cv2.fisheye.calibrate(boards, own, size, start, np.zeros((4, 1)), flags=flags)[1:3]


def _projected(fisheye: bool, solid: np.ndarray, pose: np.ndarray, camera: Calibrated) -> np.ndarray:
    if fisheye:
        points = solid.reshape(-1, 1, 3).astype(np.float64)
        return cv2.fisheye.projectPoints(points, pose[:3, None], pose[3:, None], *camera)[0].reshape(-1, 2)
    return cv2.projectPoints(solid, pose[:3], pose[3:], *camera)[0].reshape(-1, 2)


def _first_pose(fisheye: bool, solid: np.ndarray, board: np.ndarray, camera: Calibrated) -> np.ndarray:
    if fisheye:
        ideal = cv2.fisheye.undistortPoints(board.reshape(-1, 1, 2).astype(np.float64), *camera)
        return np.vstack(cv2.solvePnP(solid, ideal, np.eye(3), None)[1:3]).ravel()
    return np.vstack(cv2.solvePnP(solid, board, *camera)[1:3]).ravel()


def opencv_held_out(target: CalibrationTarget, boards: list[np.ndarray], kind: str) -> float:
    """px: root mean square of all corners, each half by OpenCV's calibration of the other; NaN where it fails."""
    calibrated = {"plain": _plain(0), "rational": _plain(cv2.CALIB_RATIONAL_MODEL), "fisheye": _fisheye}[kind]
    solid = np.column_stack([target.local, np.zeros(len(target.local))]).astype(np.float32)
    points, squares, fisheye = [target.pixels(own[0]).astype(np.float32) for own in boards], [], kind == "fisheye"
    for half in (0, 1):
        try:
            camera = calibrated(solid, points[half::2], target.size)
        except cv2.error:
            return float("nan")
        for board in points[1 - half :: 2]:

            def missed(pose: np.ndarray, board=board, camera=camera) -> np.ndarray:
                return (_projected(fisheye, solid, pose, camera) - board).ravel()

            pose = least_squares(missed, _first_pose(fisheye, solid, board, camera), method="lm").x
            squares.append((missed(pose).reshape(-1, 2) ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(squares).mean()))


def row(name: str, folder: Path, corners: tuple[int, int]) -> str:
    """One line of the table."""
    images = images_of(folder)
    seen = boards_of(images, corners)
    target, boards = seen.target, seen.whole
    begun = time.process_time()
    try:
        known = arrangement_of(boards, target)
    except GeometryError as error:
        return f"| {name} | {len(images)} | {seen.words} | {seen.peer} | {error} |" + " |" * 8
    models = tuple(map(with_affinity, (*MODELS, *WIDE_MODELS)))
    judged = compare(known.result, known.start.corners, target, models)
    chosen = choice({model: one.check for model, one in judged.items()})
    seconds = time.process_time() - begun
    result, check = judged[chosen].result, judged[chosen].check
    random, ratios = np.random.default_rng(1), []
    for _ in range(HALVES if check else 0):
        photos = random.permutation(len(boards))
        one, other = (half_of(result, np.sort(photos[side::2])) for side in (0, 1))
        variance = np.diag(one.interior_covariance + other.interior_covariance)[:CHECKED]
        ratios.append(np.abs(one.state.interior - other.state.interior)[:CHECKED] / np.sqrt(variance))
    peers = [opencv_held_out(target, boards, kind) for kind in ("plain", "rational", "fisheye")]
    bend, longest = largest_bend(result), float(np.ptp(target.local, axis=0).max())
    cells = [
        name,
        len(images),
        seen.words,
        seen.peer,
        f"{chosen.lens}, {len(chosen.free)}",
        f"{check.rms_all:.4f}" if check else "-",
        *(f"{peer:.4f}" for peer in peers),
        f"{100 * bend[1] / longest:.2f} +- {100 * bend[2] / longest:.2f}" if bend else "-",
        f"{result.correlated:.1f}",
        f"{np.mean(np.array(ratios) < 2.0):.0%}" if ratios else "-",
        f"{seconds:.0f}",
    ]
    return f"| {' | '.join(map(str, cells))} |"


def page(rows: dict[str, str]) -> str:
    """The whole page."""
    return "\n".join(
        [
            "# Sets of boards that others photographed",
            "",
            "Every second photograph is held out: its pose is estimated with the interior orientation of the others, and the root "
            f"mean square is that of **all** corners. {HALVES} random halves: share of c, x0 and y0 that differ by less than two "
            "of their stated standard errors. Bend: the largest of the board, in per cent of its longer side. Seconds are those of "
            "orthomill's choice of the lens from corners on a loaded machine. `nan`: OpenCV stops with an error. Boards are "
            "whole where nothing else is said; those that lack corners serve the calibration, but not this comparison.",
            "",
            HEAD,
            "| --- " * (HEAD.count("|") - 1) + "|",
            *(rows[name] for name in sorted(rows)),
            "",
            "Where they come from (GitHub, folder, inner corners):",
            "",
            *(f"- {name}: {source}" for name, source in SOURCES.items()),
            "",
        ]
    )


def known_rows() -> dict[str, str]:
    """The rows of the page as it lies there."""
    lines = PAGE.read_text().splitlines() if PAGE.exists() else []
    rows = [line for line in lines if line.startswith("| ") and line != HEAD and not line.startswith("| ---")]
    return {line.split("|")[1].strip(): line for line in rows}


def main(words: list[str]) -> None:
    """Measure the sets that are named."""
    cv2.setNumThreads(1)
    for argument in words:
        place, _, size = argument.rpartition(":")
        columns, lines = map(int, size.split("x"))
        # Written after every set: a long list that is stopped keeps what it has.
        rows = known_rows() | {Path(place).name: row(Path(place).name, Path(place), (columns, lines))}
        write_page("foreign_boards", words, page(rows))
