"""Chequered plates in real photographs: centres that are found beside marks that were made with care.

python -m benchmarks careful_marks

The block is `rtk_yard` of the shared data (ORTHOMILL_DATA). Marks: where the edges of the fields cross, each edge taken from both
sides of the centre, in parts of 17 px enlarged 48 times; such a mark is good to some 0.15 px by the judgement of who made them.
Plates have 17 to 20 px, their fields 5 to 8. Where no plate is found, the centre of symmetry is told all the same.
"""

import os
import sys
from pathlib import Path

import cv2
import numpy as np

from benchmarks.instrument.result_page import write_page
from orthomill.schemas.marks import FoundTarget
from orthomill.tasks.targets.photo_targets import best_centre, photo_targets

DATA = Path(os.environ.get("ORTHOMILL_DATA", Path(__file__).parents[2].parent / "shared" / "data")) / "rtk_yard"
MARKS = (
    ("white by the tree", "DJI_0010", 1175.45, 570.59),
    ("white by the tree", "DJI_0040", 1151.00, 944.06),
    ("white by the tree", "DJI_0060", 1136.40, 1180.10),
    ("white on concrete", "DJI_0010", 1389.25, 1027.37),
    ("white on concrete", "DJI_0030", 1368.80, 1250.28),
    ("white on concrete", "DJI_0070", 1579.61, 1172.63),
    ("yellow by the manhole", "DJI_0080", 1027.81, 161.00),
    ("yellow by the manhole", "DJI_0110", 1023.34, 525.17),
    ("yellow by the manhole", "DJI_0170", 1029.25, 764.37),
    ("yellow by the heap", "DJI_0170", 337.76, 522.06),
    ("white, creased", "DJI_0040", 824.28, 159.04),
    ("white, creased", "DJI_0170", 1238.23, 285.94),
)
"""plate, photograph, col, row px"""
REACH = 6.5
"""px of the reach in which these plates are found"""
HALF, NEAR = 45, 3.0
"""px of the part about a mark that is searched, and within which what is found is the plate"""


def grey_of_photograph(photo: str) -> np.ndarray:
    """Grey values (rows, cols) float32."""
    grey = cv2.imread(str(DATA / f"{photo}.JPG"), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise SystemExit(f"{DATA / photo}.JPG is not there; ORTHOMILL_DATA names the folder of the shared data.")
    return grey.astype(np.float32)


def found_near(grey: np.ndarray, col: float, row: float) -> FoundTarget | None:
    """The plate that is found at a mark."""
    left, top = max(round(col) - HALF, 0), max(round(row) - HALF, 0)
    part = grey[top : round(row) + HALF + 1, left : round(col) + HALF + 1]
    near = [
        FoundTarget(one.kind, (one.place[0] + left, one.place[1] + top), one.sigma, one.radius, one.score)
        for one in photo_targets(part)
        if one.kind == "chequered" and np.hypot(one.place[0] + left - col, one.place[1] + top - row) < NEAR
    ]
    return max(near, key=lambda one: one.score, default=None)


def symmetry_near(grey: np.ndarray, col: float, row: float) -> str:
    """What is not taken for a plate: where its symmetry lies beside the mark."""
    centre = best_centre(grey, np.array([col, row]), REACH)
    if centre is None:
        return "not found |"
    away = centre.place - (col, row)
    return f"not found (symmetry {away[0]:+.2f}, {away[1]:+.2f}; asymmetry {centre.unexplained:.2f}) | {centre.sigma:.2f}"


def main(words: list[str]) -> None:
    """Keeps the page."""
    lines = ["| plate | photograph | found beside the mark, px | its standard error, px |", "| --- | --- | --- | --- |"]
    away = []
    for plate, photo, col, row in MARKS:
        grey = grey_of_photograph(photo)
        one = found_near(grey, col, row)
        if one is None:
            lines.append(f"| {plate} | {photo} | {symmetry_near(grey, col, row)} |")
            continue
        away.append(np.subtract(one.place, (col, row)))
        lines.append(f"| {plate} | {photo} | {away[-1][0]:+.2f}, {away[-1][1]:+.2f} | {one.sigma:.2f} |")
    errors = np.array(away)
    told = (
        f"{len(MARKS)} marks on five plates of a real block, {len(away)} found: rms of a coordinate "
        f"{np.sqrt((errors**2).mean()):.2f} px, largest {np.abs(errors).max():.2f}, mean {errors[:, 0].mean():+.2f}, "
        f"{errors[:, 1].mean():+.2f}; the marks' own error is in it."
    )
    write_page("careful_marks", words, "\n".join(["# Centres found beside careful marks", "", told, "", *lines]))


if __name__ == "__main__":
    main(sys.argv[1:])
