"""A town whose photographs show plates without a number: what `orthomill mark --auto` finds of them, and how far off.

python -m benchmarks plain_photographs RUN

RUN: the folder of a finished run of volos_small. Plates of four fields, crosses and circles are laid level on its ground and drawn
into its photographs where its block sees them. The project is oriented by its positions; most plates have coordinates in a list,
with the standard errors of a survey, and some are for the command to find.
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np

import orthomill
from benchmarks.instrument.result_page import write_page
from benchmarks.marking.coded_photographs import corners_of, orthomill_says, plates, with_plates, write_photographs, write_workflow
from benchmarks.marking.drawn_targets import pattern
from orthomill.tasks.geometry.view import View, block_view

SIDE = 20.0
"""m of a plate: 31 px of these photographs"""
KINDS = ("chequered", "cross", "circle")
LISTED, UNLISTED = 12, 3
SURVEYED = 0.02
"""m: standard error of a listed coordinate"""
NEAR = 2.0
"""px within which a mark is on its plate"""
STAGES = ["photos", "calibration", "tie_points", "orientation"]


def main(words: list[str]) -> None:
    """Keeps the page."""
    source = Path(words[0]) if words else Path("runs/volos_small")
    finished = orthomill.open(source)
    views = [block_view(finished.block, name) for name in finished.block.names]
    places = plates(views, source / "products" / "dsm.tif", SIDE, LISTED + UNLISTED)
    with tempfile.TemporaryDirectory(prefix="plain-") as folder:
        root = Path(folder)
        pictures = [plate_picture(kind_of(number)) for number in range(len(places))]
        write_photographs(root, source, views, lambda pixels, view: with_plates(pixels, view, places, SIDE, pictures))
        write_workflow(root, "plain", {"kind": "none"}, STAGES)
        rng = np.random.default_rng(1)
        rows = (f"{name_of(i)},{','.join(f'{v:.3f}' for v in places[i] + rng.normal(0, SURVEYED, 3))}" for i in range(LISTED))
        (root / "points.csv").write_text("\n".join(["name,x,y,z", *rows]) + "\n")
        orthomill_says(root, "run", "plain")
        orthomill_says(root, "mark", "plain", "--points", "points.csv", "--auto")
        with (root / "marks" / "plain" / "measurements.csv").open() as text:
            marks = {
                (row["name"], row["photo"]): np.array([float(row[k]) for k in ("col", "row", "sigma")])
                for row in csv.DictReader(text)
            }
    write_page("plain_photographs", words, page(marks, views, places))


def kind_of(number: int) -> str:
    """What a plate shows; nobody looks for circles that are not listed."""
    return KINDS[number % (len(KINDS) if number < LISTED else 2)]


def name_of(number: int) -> str:
    """The name of a plate in the list."""
    return f"{kind_of(number)} {number}"


def plate_picture(kind: str) -> np.ndarray:
    """A square picture (rows, cols) float32 of 0 to 255."""
    axis = (np.arange(400) + 0.5) / 200 - 1.0
    return (255.0 * pattern(kind, *np.meshgrid(axis, axis))).astype(np.float32)


def page(marks: dict[tuple[str, str], np.ndarray], views: list[View], places: np.ndarray) -> str:
    """What was found of each kind, and what is on no plate."""
    lines = [
        "| plates | shown | marked | rms of a coordinate, px | largest, px | error by standard error, rms |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    shown = {
        (i, view.name): view.project(places[[i]])[0]
        for i in range(len(places))
        for view in views
        if corners_of(view, places[i], SIDE) is not None
    }
    own: dict[tuple[int, str], np.ndarray] = {}
    false = []
    for (name, photo), mark in marks.items():
        near = [key for key, place in shown.items() if key[1] == photo and np.hypot(*(place - mark[:2])) < NEAR]
        right = [key for key in near if key[0] >= LISTED or name == name_of(key[0])]
        if right:
            own[right[0]] = np.append(mark[:2] - shown[right[0]], mark[2])
        else:
            false.append(f"{name} in {photo}")
    groups = [(kind, [i for i in range(LISTED) if kind_of(i) == kind]) for kind in KINDS]
    for what, numbers in (*groups, ("not listed", list(range(LISTED, len(places))))):
        asked = [key for key in shown if key[0] in numbers]
        found = np.array([own[key] for key in asked if key in own]).reshape(-1, 3)
        away, ratio = found[:, :2], found[:, :2] / found[:, 2:]
        figures = f"{np.sqrt((away**2).mean()):.3f} | {np.abs(away).max(initial=0):.2f} | {np.sqrt((ratio**2).mean()):.2f}"
        lines.append(f"| {what} | {len(asked)} | {len(found)} | {figures} |")
    told = (
        f"Plates of {SIDE:.0f} m in photographs of 599 px, {LISTED} of them in a list of coordinates; `orthomill mark --auto` on "
        f"the block that its positions orient. Marked: {len(own)} of {len(shown)}. On no plate, or on another: {len(false)}"
        f"{' (' + ', '.join(false) + ')' if false else ''}."
    )
    return "\n".join(["# Photographs with plates that have no number", "", told, "", *lines])


if __name__ == "__main__":
    main(sys.argv[1:])
