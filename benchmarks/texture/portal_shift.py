"""Where the shift of the portal's front comes from: the measure, resampling, the surface, the block.

`python -m benchmarks portal_shift runs/portal` takes a run of the workflow `portal` that has its orientation, projects its
front with the block and the surface as they were found and as they are in truth, and writes
`benchmarks/results/portal_shift.md`. Each row differs from the one before by one thing. Below the table stands what the surveyed
coordinates shift by themselves: a block can lie no better than its control.
"""

import csv
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from benchmarks.texture.portal_truth import PortalCase, fitted, of_run, projected, shifts_of
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.simulation.portal.portal_block import to_system
from orthomill.tasks.simulation.portal.portal_mesh import portal_mesh
from orthomill.tasks.simulation.portal.portal_rendering import TRUE_CELL
from orthomill.tasks.simulation.portal.portal_targets import TARGETS

NOISE, BLUR = 1.5, 1.0
"""grey levels; px: what photographs of about the pixel of the front do to it"""


def true_surface() -> TriangleMesh:
    """The portal as it was photographed."""
    mesh = portal_mesh(TRUE_CELL)
    return TriangleMesh(to_system(mesh.vertices), mesh.triangles)


def fronts(case: PortalCase) -> Iterator[tuple[str, np.ndarray]]:
    """Pictures (rows, cols, 4) or (rows, cols, 3) of the front."""
    truth = case.front.astype(np.float32)
    blurred = cv2.GaussianBlur(truth, (0, 0), BLUR)
    yield "the measure: the truth, blurred and with noise", blurred + np.random.default_rng(1).normal(0, NOISE, truth.shape)
    ideal = replace(case, block=case.true_block)
    yield "true block, true surface: and resampling", projected(replace(ideal, mesh=true_surface()), {})
    yield "true block, scanned surface: and the scan", projected(ideal, {})
    yield "the block as it was found: and orientation and control", projected(case, {})


def row(label: str, picture: np.ndarray, case: PortalCase) -> str:
    """A row of the table."""
    truth = case.front.astype(float)
    known = (np.bitwise_count(case.visible) >= 2) & np.isfinite(case.depth)
    if picture.shape[2] == 4:
        known &= picture[..., 3] > 0
    found = shifts_of(fitted(picture[..., :3].astype(float), truth, known), truth, known)
    middle = np.median(found, axis=0)
    whole, rest = (np.percentile(np.hypot(*(found - offset).T), 95) for offset in (0.0, middle))
    return f"| {label} | {len(found)} | {whole:.2f} | {middle[0]:+.2f}, {middle[1]:+.2f} | {rest:.2f} |"


def similarity(points: np.ndarray, others: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Places (N, 3) moved by the similarity that fits points (M, 3) to others (M, 3) best (Horn 1987; Umeyama 1991)."""
    middle, other = points.mean(axis=0), others.mean(axis=0)
    left, size, right = np.linalg.svd((others - other).T @ (points - middle))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    scale = (size * signs).sum() / ((points - middle) ** 2).sum()
    return np.asarray(other + scale * (places - middle) @ (left * signs @ right).T)


def control_shift(folder: Path, pixel: float) -> np.ndarray:
    """Shifts (N, 2) px, to the right and downwards, of places of the front by the errors of the surveyed control points alone."""
    with (folder / "photographs" / "control.csv").open() as file:
        surveyed = np.array([[row["x"], row["y"], row["z"]] for row in csv.DictReader(file) if row["role"] == "control"], float)
    x, z = (values.ravel() for values in np.meshgrid(np.linspace(-3, 3, 61), np.linspace(0, 6, 61)))
    places = to_system(np.column_stack([x, np.zeros(x.size), z]))
    right = to_system(np.array([1.0, 0.0, 0.0])) - to_system(np.zeros(3))
    moved = similarity(to_system(TARGETS[: len(surveyed)]), surveyed, places) - places
    return np.column_stack([moved @ right, -moved[:, 2]]) / pixel


def control_words(shifts: np.ndarray) -> str:
    """What the control shifts, as a sentence."""
    middle = np.median(shifts, axis=0)
    return (
        f"The surveyed coordinates of the control points, each wrong by 1 mm, shift the front by themselves by {middle[0]:+.2f}, "
        f"{middle[1]:+.2f} px (median) and {np.percentile(np.hypot(*shifts.T), 95):.2f} px at 95 %: the best similarity between "
        "them and the true ones, applied to the front."
    )


def main(words: list[str]) -> None:
    """Measure and write the page."""
    (folder,) = run_folders(words, "portal")
    case = of_run(folder)
    lines = [
        "# The shift of the portal's front",
        "",
        f"Windows of 64 px with structure that two photographs or more see, {1000 * case.pixel:g} mm a pixel.",
        "",
        "| what is in it | windows | shift at 95 %, px | of all together (median), px | at 95 % without it |",
        "| --- | --- | --- | --- | --- |",
        *(row(label, picture, case) for label, picture in fronts(case)),
        "",
        control_words(control_shift(folder, case.pixel)),
    ]
    write_page("portal_shift", words, "\n".join(lines))
