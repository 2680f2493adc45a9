"""Straight edges against the houses of a simulated town: how far they lie from the true sides of roofs, and whether they say so.

The town's houses are rectangles with level or saddle roofs, so that every eave and every half of a gable is a line in space. A line
is compared in its middle, with the side of the nearest house that faces as it does.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.storage.store import Store
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.maps.straight_edges import StraightEdges, edge_sheets, straight_edges_table
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import ORTHO, SURFACE
from orthomill.tasks.catalogue import STAGES
from orthomill.tasks.simulation.plan.simulation_jobs import site_of
from orthomill.tasks.simulation.scene.layout import Buildings
from orthomill.tasks.simulation.scene.settlement import scene_of
from orthomill.tasks.simulation.stage import SimulationStage

NEAR = 2.5
"""cells of the surface model from a side within which a line belongs to it"""


class FoundSides(NamedTuple):
    """Lines (N,) at sides of houses: `across` m outwards of the side, `above` m above it, `turn` degrees from its direction, and
    `length` m; their stated standard errors, m; whether the side is a gable."""

    across: np.ndarray
    above: np.ndarray
    turn: np.ndarray
    length: np.ndarray
    sigma_across: np.ndarray
    sigma_height: np.ndarray
    gable: np.ndarray


def houses_of(run: Path) -> Buildings:
    """The houses of a run's simulation."""
    stages = load_workflow(run / "workflow.yaml", STAGES).stages
    asked = next(stage for stage in stages if isinstance(stage, SimulationStage))
    return scene_of(site_of(asked).scene).buildings


def found_sides(lines: StraightEdges, houses: Buildings, cell: float) -> FoundSides:
    """The lines of which the middle lies near a side of a house."""
    first, last = lines.take(np.arange(0, len(lines), 2)), lines.take(np.arange(1, len(lines), 2))
    x, y, z = (0.5 * (getattr(first, axis) + getattr(last, axis)) for axis in "xyz")
    dx, dy = last.x - first.x, last.y - first.y
    length = np.hypot(dx, dy)
    u, v = _local(houses, x[:, None] - houses.x, y[:, None] - houses.y)
    # Upper surfaces lie to the left of their edges.
    out_u, out_v = _local(houses, (dy / length)[:, None], (-dx / length)[:, None])
    gable = np.abs(out_u) > np.abs(out_v)
    across = np.where(gable, np.abs(u) - houses.half_length, np.abs(v) - houses.half_width)
    beside = np.where(gable, np.abs(v) - houses.half_width, np.abs(u) - houses.half_length)
    house = np.argmin(np.abs(across) + np.maximum(beside, 0.0), axis=1)
    here = np.arange(len(x)), house
    roof = houses.eaves[house] + np.where(
        gable[here], houses.rise[house] * (1.0 - np.minimum(np.abs(v[here]) / houses.half_width[house], 1.0)), 0.0
    )
    turn = np.degrees(np.arctan2(np.minimum(np.abs(out_u), np.abs(out_v)), np.maximum(np.abs(out_u), np.abs(out_v))))[here]
    at = (np.abs(across[here]) < NEAR * cell) & (beside[here] < 0)
    columns = across[here], z - roof, turn, length, first.sigma_across, first.sigma_height, gable[here]
    return FoundSides(*(values[at] for values in columns))


def _local(houses: Buildings, dx: np.ndarray, dy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Along and across the houses (N, B)."""
    return dx * houses.cos + dy * houses.sin, dy * houses.cos - dx * houses.sin


def sides_on(grid: MapGrid, houses: Buildings) -> float:
    """m of the sides of the houses whose middle lies on a grid."""
    col, row = grid.pixel(houses.x, houses.y)
    inside = (row > 0) & (col > 0) & (row < grid.rows) & (col < grid.cols)
    return float(4.0 * (houses.half_length + houses.half_width)[inside].sum())


def _row(name: str, found: FoundSides) -> str:
    """A line of the table."""
    spread = 1.4826 * float(np.median(np.abs(found.across - np.median(found.across))))
    parts = [f"{len(found.across)}", f"{np.median(found.across):+.3f}", f"{spread:.3f}", f"{np.median(found.sigma_across):.3f}"]
    parts.append(_within(found.across, found.sigma_across))
    high = 1.4826 * float(np.median(np.abs(found.above - np.median(found.above))))
    parts += [f"{np.median(found.above):+.3f}", f"{high:.3f}", f"{np.median(found.sigma_height):.3f}"]
    parts.append(_within(found.above, found.sigma_height))
    return f"| {name} | {' | '.join(parts)} | {np.median(found.turn):.2f} |"


def _within(error: np.ndarray, sigma: np.ndarray) -> str:
    return " / ".join(f"{100 * np.mean(np.abs(error) < k * sigma):.0f}" for k in (1, 2))


def main(words: list[str]) -> None:
    """The page."""
    lines = ["# Straight edges against true sides of roofs", ""]
    lines += [
        "| lines | number | across: median m | NMAD m | stated m | within 1 / 2 sigma % | height: median m | NMAD m | stated m "
        "| within 1 / 2 sigma % | direction, median degrees |",
        "| --- " * 11 + "|",
    ]
    notes = []
    for word in words or ["runs/volos"]:
        run, store = Path(word), Store(Path(word))
        grid, shape = store.table(SURFACE).grid, store.spec(ORTHO).shape
        size = load_workflow(run / "workflow.yaml", STAGES).project.tile
        houses, found, count = houses_of(run), [], 0
        for sheet in edge_sheets(shape[:2], size):
            table = store.table(straight_edges_table(sheet))
            count += len(table) // 2
            found.append(found_sides(table, houses, grid.cell))
        sides = FoundSides(*(np.concatenate(values) for values in zip(*found, strict=True)))
        for kind, chosen in (("eaves", ~sides.gable), ("gables", sides.gable)):
            lines.append(_row(f"{run.name}, {kind}", FoundSides(*(values[chosen] for values in sides))))
        share = 100 * sides.length.sum() / sides_on(grid, houses)
        notes.append(
            f"{run.name}: {count} lines, {100 * len(sides.across) / max(count, 1):.1f} % of them at a side of a house; "
            f"{share:.0f} % of the sides of all houses have a line; a pixel is {grid.cell:g} m in the surface model."
        )
    lines += [
        "",
        *notes,
        "",
        "Sides lie where the scene has its houses; a block that is off as a whole is not told apart from its lines.",
    ]
    write_page("edge_truth", words, "\n".join(lines))
