"""A town whose photographs carry codes: `control: {kind: targets}` through the engine to products, and how far off they are.

python -m benchmarks coded_photographs RUN

RUN: the folder of a finished run of volos_small. Plates with AprilTags are laid level on its ground, drawn into its photographs
where its block sees them, and these run as a project of their own, with their positions and the coordinates of six plates; two
more are check points, and two are known by nothing but their code.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import rasterio
import yaml

import orthomill
from benchmarks.instrument.result_page import write_page
from orthomill.schemas.observations import CONTROL
from orthomill.tasks.geometry.view import View, block_view

SIDE = 30.0
"""m of a plate with its white border: 46 px of these photographs"""
ROOM = 45.0
"""m between plates, and from the border of what three photographs see"""
FINER = 6
"""samples of a pixel along and across"""
BLUR = 0.6
"""px"""
CONTROL_PLATES, CHECK_PLATES, CODES_ONLY = 6, 2, 2
STAGES = ["photos", "calibration", "tie_points", "orientation", "epipolar", "densification", "dsm_check", "texture"]


def main(words: list[str]) -> None:
    """Keeps the page."""
    source = Path(words[0]) if words else Path("runs/volos_small")
    finished = orthomill.open(source)
    views = [block_view(finished.block, name) for name in finished.block.names]
    places = plates(views, source / "products" / "dsm.tif", SIDE, CONTROL_PLATES + CHECK_PLATES + CODES_ONLY)
    with tempfile.TemporaryDirectory(prefix="coded-") as folder:
        root = Path(folder)
        write_project(root, source, views, places)
        orthomill_says(root, "run", "coded")
        if keep := os.environ.get("KEEP"):
            shutil.copytree(root, keep)
        write_page("coded_photographs", words, page(root / "runs" / "coded", views, places))


def orthomill_says(root: Path, *words: str) -> str:
    """What the command answers below a folder; ends with its error."""
    command = [Path(sys.executable).with_name("orthomill"), *words]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{done.stdout}\n{done.stderr}")
    return done.stdout


def plates(views: list[View], surface: Path, side: float, count: int) -> np.ndarray:
    """(count, 3) m: centres of plates on the most level ground that three photographs or more see, apart from each other."""
    with rasterio.open(surface) as dsm:
        height, at = dsm.read(1, masked=True).filled(np.nan), dsm.transform
    half = round(side / 2 / at.a)
    rows, cols = (range(half, length - half, half) for length in height.shape)
    found: list[tuple[float, np.ndarray]] = []
    for row in rows:
        for col in cols:
            part = height[row - half : row + half + 1, col - half : col + half + 1]
            if np.isfinite(part).all():
                x, y = at * (col + 0.5, row + 0.5)
                found.append((float(np.ptp(part)), np.array([x, y, float(part.max())])))
    kept: list[np.ndarray] = []
    for _, place in sorted(found, key=lambda one: one[0]):
        if all(np.hypot(*(place - other)[:2]) > ROOM for other in kept) and _seen(views, place) >= 3:
            kept.append(place)
    if len(kept) < count:
        raise SystemExit(f"There is room for {len(kept)} plates, not for {count}.")
    # Control about the block first: the farthest from what is there already.
    chosen = kept[:1]
    while len(chosen) < count:
        chosen.append(max(kept, key=lambda place: min(float(np.hypot(*(place - other)[:2])) for other in chosen)))
    return np.array(chosen)


def _seen(views: list[View], place: np.ndarray) -> int:
    corners = place + ROOM / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return sum(bool(view.contains(view.project(corners), 4.0).all()) for view in views)


def corners_of(view: View, place: np.ndarray, side: float) -> np.ndarray | None:
    """(4, 2) px: the corners of a level plate in a photograph; None where it does not see all of it."""
    corners = view.project(place + side / 2 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]))
    return corners if view.contains(corners, 4.0).all() else None


def code_picture(number: int) -> np.ndarray:
    """A square picture (rows, cols) float32 of 0 to 255 of an AprilTag with a white border."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    code = np.pad(cv2.aruco.generateImageMarker(family, number, 8), 1, constant_values=255)
    return np.kron(code, np.ones((40, 40), np.uint8)).astype(np.float32)


def with_plates(pixels: np.ndarray, view: View, places: np.ndarray, side: float, pictures: list[np.ndarray]) -> np.ndarray:
    """A photograph (rows, cols, bands) uint8 with plates of `side` m, each with its picture, at the places that it sees all of."""
    out = pixels.astype(np.float32)
    for place, picture in zip(places, pictures, strict=True):
        corners = corners_of(view, place, side)
        if corners is None:
            continue
        edge = picture.shape[0]
        low, high = np.floor(corners.min(axis=0)).astype(int) - 3, np.ceil(corners.max(axis=0)).astype(int) + 4
        # Corners of pixels, where OpenCV counts from centres.
        fine = ((corners - low + 0.5) * FINER - 0.5).astype(np.float32)
        square = np.array([[0, 0], [edge, 0], [edge, edge], [0, edge]], np.float32) - 0.5
        to_fine = cv2.getPerspectiveTransform(square, fine)
        size = tuple(int(n) * FINER for n in high - low)
        plate = cv2.warpPerspective(picture, to_fine, size, flags=cv2.INTER_AREA)
        there = cv2.warpPerspective(np.ones_like(picture), to_fine, size, flags=cv2.INTER_AREA)
        plate, there = (cv2.GaussianBlur(one, (0, 0), BLUR * FINER) for one in (plate, there))
        plate, there = (one.reshape(size[1] // FINER, FINER, size[0] // FINER, FINER).mean(axis=(1, 3)) for one in (plate, there))
        window = np.s_[low[1] : high[1], low[0] : high[0]]
        out[window] = out[window] * (1 - there[..., None]) + (0.75 * plate + 25.0 * there)[..., None]
    return np.clip(np.round(out), 0, 255).astype(np.uint8)


def write_project(root: Path, source: Path, views: list[View], places: np.ndarray) -> None:
    """The project `coded` below a folder: photographs, positions, camera, and coordinates of the plates."""
    pictures = [code_picture(number) for number in range(len(places))]
    write_photographs(root, source, views, lambda pixels, view: with_plates(pixels, view, places, SIDE, pictures))
    listed = places[: CONTROL_PLATES + CHECK_PLATES]
    rows = [
        f"tag36h11-{number},{'control' if number < CONTROL_PLATES else 'check'},{x:.4f},{y:.4f},{z:.4f},0.02,0.02,0.02"
        for number, (x, y, z) in enumerate(listed)
    ]
    (root / "control" / "points.csv").write_text("\n".join(["name,role,x,y,z,sigma_x,sigma_y,sigma_z", *rows]) + "\n")
    write_workflow(root, "coded", {"kind": "targets", "points": "control/points.csv"}, STAGES)


def write_photographs(root: Path, source: Path, views: list[View], changed: Callable[[np.ndarray, View], np.ndarray]) -> None:
    """The photographs of a run below a folder, as they are `changed`, with their positions and camera."""
    for name in ("photos", "workflows", "control"):
        (root / name).mkdir()
    for view in views:
        picture = cv2.imread(str(source / "photographs" / f"{view.name}.tif"))
        cv2.imwrite(str(root / "photos" / f"{view.name}.tif"), changed(picture, view))
    shutil.copy(source / "photographs" / "positions.csv", root / "control" / "positions.csv")
    shutil.copy(source / "products" / "camera.json", root / "control" / "camera.json")


def write_workflow(root: Path, project: str, control: dict[str, str], stages: list[str]) -> None:
    """The workflow of a project below a folder."""
    workflow = {
        "project": project,
        "crs": "EPSG:2100",
        "photographs": {"kind": "folder", "path": "photos"},
        "cameras": {"kind": "file", "path": "control/camera.json"},
        "positions": {"kind": "file", "path": "control/positions.csv"},
        "control": control,
        "tile": 256,
        "stages": stages,
    }
    (root / "workflows" / f"{project}.yaml").write_text(yaml.safe_dump(workflow, sort_keys=False))


def page(run: Path, views: list[View], places: np.ndarray) -> str:
    """What was found and what it gave."""
    finished = orthomill.open(run)
    control = finished.table(CONTROL)
    errors, asked, found = [], 0, 0
    by_name = {point.name: point for point in control.points}
    for number, place in enumerate(places):
        for view in views:
            if corners_of(view, place, SIDE) is None:
                continue
            asked += 1
            mark = by_name[f"tag36h11-{number}"].measurements.get(view.name) if f"tag36h11-{number}" in by_name else None
            if mark is not None:
                found += 1
                errors.append(np.array(mark[:2]) - view.project(place[None])[0])
    away = np.array(errors)
    figures = json.loads((run / "summary.json").read_text())
    lines = [f"| {name} | {one['value']} |" for name, one in figures.items() if name.startswith("orientation.") and "value" in one]
    roles = {role: sum(point.role == role for point in control.points) for role in ("control", "check", "tie")}
    return "\n".join(
        [
            "# Photographs that carry codes",
            "",
            f"Plates of {SIDE:.0f} m in photographs of 599 px; the project ran to {STAGES[-1]}. Codes drawn: {asked}, "
            f"found: {found}, others found: {sum(len(p.measurements) for p in control.points) - found}. Centres: rms "
            f"{np.sqrt((away**2).mean()):.3f} px, largest {np.abs(away).max():.2f} px. Points: {roles}. Products: "
            f"{', '.join(sorted(path.name for path in (run / 'products').glob('*.tif')))}.",
            "",
            "| figure | value |",
            "| --- | --- |",
            *lines,
        ]
    )


if __name__ == "__main__":
    main(sys.argv[1:])
