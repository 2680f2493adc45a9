"""Calibration of large photos: time of search and adjustment, and the set of 34 photos of 20 megapixels as a whole."""

import json
import resource
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from benchmarks.calibration.board_setups import FIVE_BOARDS, places_of, views_of
from benchmarks.measured_run import orthomill
from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import Window
from orthomill.tasks.calibration.detection.board_detection import COARSE_SIDE, find_boards, pyramid
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.model_choice import compare
from orthomill.tasks.calibration.solving.solving import CalibrationTarget, solve
from orthomill.tasks.simulation.boards.board_rendering import BoardFilm, photograph_floor

KEPT = Path(__file__).parents[2] / ".cache" / "calibration_34_photos"


def large_photos(found: list[np.ndarray], target: CalibrationTarget) -> str:
    """Search in 20-megapixel photos with five boards, and all adjustments of 34, whose corners (B, N, 2) are `found`."""
    camera, spent = FIVE_BOARDS.camera, []
    for number in (0, 7):
        image = large_photo(number)
        start = time.process_time()
        boards = find_boards(pyramid(image, COARSE_SIDE), FIVE_BOARDS.board.corners, 5)
        spent.append((time.process_time() - start, len(boards.corners)))
    start = time.process_time()
    known = arrangement_of(found, target)
    named = time.process_time()
    solve(target, known.start.states, known.start.corners, MODELS[1].free)
    bundle = time.process_time()
    compare(known.result, known.start.corners, target, MODELS)
    judged = time.process_time()
    return (
        f"{camera.width} x {camera.height} pixels, five boards: {', '.join(f'{n} boards in {s:.1f} s' for s, n in spent)} of CPU "
        f"for the search. Of 34 photos ({len(known.start.corners)} corners), the names of the boards with a first calibration "
        f"take {named - start:.1f} s, the bundle {bundle - named:.2f} s, four models on both halves {judged - bundle:.1f} s."
    )


def large_photo(number: int) -> np.ndarray:
    """A photo (rows, cols) uint8 of the published set of 34."""
    camera, film = FIVE_BOARDS.camera, BoardFilm(0.7, 2.0, 0.2, seed=number)
    whole = Window(0, 0, camera.height, camera.width)
    return photograph_floor(views_of(FIVE_BOARDS)[number], places_of(FIVE_BOARDS), FIVE_BOARDS.board, film, whole)


def whole_set() -> str:
    """The 34 rendered photos in colour, as files, calibrated by the command with two workers; they are kept for the next run."""
    # Rendering takes longer than the calibration; the files do not depend on what is measured.
    KEPT.mkdir(parents=True, exist_ok=True)
    for number in range(FIVE_BOARDS.photos):
        path = KEPT / f"board_{number + 1:02d}.jpg"
        if not path.exists():
            grey = large_photo(number)
            # Unequal bands: the conversion to grey is part of what is measured.
            tinted = np.stack([(grey * share).astype(np.uint8) for share in (0.9, 1.0, 0.95)], axis=-1)
            cv2.imwrite(str(path), tinted, [cv2.IMWRITE_JPEG_QUALITY, 95])
    with tempfile.TemporaryDirectory() as place:
        words = ("--boards", "5", "--corners", "5x4", "--square", "0.0359", "--workers", "2", "--memory", "1024", "--name", "whole")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run = orthomill(Path(place), "calibrate", str(KEPT), *words)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        results = Path(place) / "runs" / "whole"
        figures = json.loads((results / "summary.json").read_text())
        camera = Camera.model_validate_json((results / "products" / "camera.json").read_text())
    # Children only: the workers' CPU time, without that of this process.
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    said = {name: figures[f"calibration.{name}"]["value"] for name in ("boards", "sigma0_px", "held_out_px", "iterations")}
    errors = (np.array(camera.interior) - FIVE_BOARDS.camera.interior) / np.sqrt(np.maximum(np.diag(camera.covariance), 1e-300))
    known = np.diag(camera.covariance) > 0
    return (
        f"The whole set as 34 colour JPEG files, `orthomill calibrate` with two workers: {seconds:.0f} s of CPU in all, largest "
        f"worker {run.peak_bytes / 2**20:.0f} MiB; {said['boards']} boards, {said['iterations']} iterations, sigma0 "
        f"{said['sigma0_px']} px, held out {said['held_out_px']} px, c {camera.c:.2f} +- {camera.covariance[0][0] ** 0.5:.2f} "
        f"(truth {FIVE_BOARDS.camera.c}), largest error of a parameter {np.abs(errors[known]).max():.1f} standard errors."
    )
