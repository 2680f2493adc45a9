"""Marks as the files that other programs and the stage `orientation` read: CSV with our own columns, and gcp_list.txt."""

import csv
import io
from collections.abc import Iterable

from orthomill.schemas.marks import MarkedPoint, Marks
from orthomill.schemas.observations import Distance

POINTS, MEASUREMENTS, DISTANCES, GCP_LIST = "points.csv", "measurements.csv", "distances.csv", "gcp_list.txt"


def mark_files(marks: Marks, crs: str) -> dict[str, str]:
    """The texts of all files, by their names: what an adjustment can use of the marks. `crs`: system of the coordinates."""
    usable = [point for point in marks.points if is_usable(point)]
    distances = [one for one in marks.distances if not left_out(one, marks)]
    return {
        POINTS: _csv(("name", "role", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), map(_point_row, usable)),
        MEASUREMENTS: _csv(
            ("name", "photo", "col", "row", "sigma"),
            (
                (point.name, photo, f"{mark.col:.3f}", f"{mark.row:.3f}", f"{mark.sigma:.3f}")
                for point in usable
                for photo, mark in point.marks.items()
            ),
        ),
        DISTANCES: _csv(("from", "to", "metres", "sigma"), ((d.first, d.second, repr(d.length), repr(d.sigma)) for d in distances)),
        GCP_LIST: "\n".join([crs, *_gcp_lines(usable)]) + "\n",
    }


def is_usable(point: MarkedPoint) -> bool:
    """Whether an adjustment can use a point: marked, in two photographs where its coordinates are not known."""
    needed = 2 if point.role == "tie" else 1
    return point.role != "unused" and len(point.marks) >= needed and (point.role == "tie" or point.xyz is not None)


def left_out(distance: Distance, marks: Marks) -> str:
    """Why no adjustment is given a distance; empty where one is. One to a check point is compared with the block."""
    for name in (distance.first, distance.second):
        point = next((one for one in marks.points if one.name == name), None)
        if point is None or point.role == "unused":
            return f"{name} is unused"
        # Known coordinates place a control point; any other end of a distance is where its rays meet.
        needed = 1 if point.role == "control" and point.xyz is not None else 2
        if len(point.marks) < needed:
            return f"{name} has {len(point.marks)} of the {needed} marks that it needs"
        if not is_usable(point):
            return f"{name} has no coordinates"
    return ""


def _point_row(point: MarkedPoint) -> tuple[str, ...]:
    if point.role == "tie" or point.xyz is None:
        return (point.name, "tie", *("",) * 6)
    return (point.name, point.role, *(f"{value:.4f}" for value in point.xyz), *(f"{value:.4f}" for value in point.sigma))


def _gcp_lines(points: Iterable[MarkedPoint]) -> Iterable[str]:
    for point in points:
        # Blanks separate the columns of this format; only the name of a photograph, which has a suffix, may hold some.
        name = "_".join(point.name.split())
        for photo, mark in point.marks.items():
            if point.xyz is not None and point.role in ("control", "check"):
                place = " ".join(f"{value:.4f}" for value in point.xyz)
                yield f"{place} {mark.col:.3f} {mark.row:.3f} {photo} {name}"


def _csv(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return out.getvalue()
