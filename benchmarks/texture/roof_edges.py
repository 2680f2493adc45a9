"""How much of the jaggedness of roof edges is the measure's own: an orthoimage beside the true one, blurred.

The true orthoimage of a simulated town has straight edges, however much it is blurred. What is found on it are false finds:
profiles that lost what told them apart, and fit better at a shadow or a tile of the roof. Photographs blur by pixels and cameras,
and an orthoimage is as sharp as one of the blurred ones: so much of its figure no surface takes away.

What the report of every run says without truth stands beside it: the same edges against photographs that show them straight.
"""

import json
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.schemas.surface import ORTHO, SURFACE
from orthomill.schemas.truth import TRUTH_GRID, TRUTH_MATERIAL, TRUTH_ORTHO, TRUTH_VISIBILITY, Material
from orthomill.tasks.evaluation.grids import codes_on, colours_on, placement
from orthomill.tasks.evaluation.orthoimage_accuracy import HALO, channel_mean
from orthomill.tasks.evaluation.roof_lines import departures
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.texture.ground.extent import ground_pixels, ortho_grid

BLURS = (0.4, 0.6, 0.8, 1.0)
"""px, sigma of the Gaussian"""
NOISE = 1.0
"""grey levels, of a mean of the simulated photographs"""
FAR = 2.0
"""px from the line: most of what lies beyond is a false find"""
TILE = 512


class FoundEdges(NamedTuple):
    """Departures (pieces, profiles) px of the edges, NaN where none was found, and on open ground the sum of the squared
    differences from the orthoimage, grey levels."""

    away: np.ndarray
    unlike: float


def edges_of(run: Path) -> list[FoundEdges]:
    """Of the orthoimage, then of the true one by BLURS."""
    store, rng = Store(run), np.random.default_rng(1)
    block, truth = store.table(BLOCK), store.table(TRUTH_GRID)
    pixel = median(ground_pixels([block_view(block, name) for name in block.names], block.ground_mean))
    grid = ortho_grid(store.table(SURFACE).grid, None, pixel)
    away: list[list[np.ndarray]] = [[] for _ in range(1 + len(BLURS))]
    unlike = np.zeros(1 + len(BLURS))
    for tile in tiles_of(grid.shape, TILE):
        core = tile.window
        window = core.grown(HALO).clipped(grid.shape)
        scene = _scene(store, grid, window, truth)
        inner = core.within(window).slices
        if not (scene.roof & scene.seen)[inner].any():
            continue
        known = np.isfinite(scene.true)
        blurred = [gaussian_filter(np.where(known, scene.true, 0.0), blur) for blur in BLURS]
        noisy = [np.where(known, image + rng.normal(0, NOISE, image.shape), np.nan) for image in blurred]
        for k, grey in enumerate([scene.ortho, *noisy]):
            away[k].append(departures(grey, scene.true, scene.roof, scene.seen, (window.row, window.col), inner))
        for k, image in enumerate(blurred, start=1):
            unlike[k] += np.nansum(((image - scene.ortho)[scene.open]) ** 2)
    return [FoundEdges(np.concatenate(kept), float(sum_)) for kept, sum_ in zip(away, unlike, strict=True)]


class _Scene(NamedTuple):
    """Mean channels of the orthoimage, fitted to the truth, and of the truth, NaN where unknown; roofs, what two photographs show,
    and open ground, bool."""

    ortho: np.ndarray
    true: np.ndarray
    roof: np.ndarray
    seen: np.ndarray
    open: np.ndarray


def _scene(store: Store, grid: MapGrid, window: Window, truth: MapGrid) -> _Scene:
    place = placement(grid, window, truth)
    colours, true = store.read(ORTHO, window), channel_mean(colours_on(store.read(TRUTH_ORTHO, place.source_window), place))
    grey = np.where(colours[..., 3] > 0, channel_mean(colours[..., :3].astype(np.float32)), np.nan)
    both = np.isfinite(grey) & np.isfinite(true)
    gain, offset = np.polyfit(grey[both], true[both], 1) if both.sum() > 100 else (1.0, 0.0)
    shown = np.bitwise_count(store.read(TRUTH_VISIBILITY, place.source_window).astype(np.uint32)).astype(np.uint8)
    material = codes_on(store.read(TRUTH_MATERIAL, place.source_window), place)
    seen = codes_on(shown, place) >= 2
    return _Scene(gain * grey + offset, true, material == Material.ROOF, seen, seen & (material == Material.OPEN_GROUND))


def row_of(name: str, away: np.ndarray) -> str:
    """A line of the table."""
    known = away[np.isfinite(away)]
    squares, far = known**2, np.abs(known) > FAR
    of_piece = np.sqrt(np.nanmean(away**2, axis=1))
    shares = f"{100 * far.mean():.1f} | {100 * squares[far].sum() / squares.sum():.0f}"
    without = np.sqrt(squares[~far].mean())
    return f"| {name} | {len(away)} | {np.sqrt(squares.mean()):.2f} | {np.median(of_piece):.2f} | {shares} | {without:.2f} |"


def _is_simulated(run: Path) -> bool:
    return Store(run).has_table(TRUTH_GRID)


def photograph_row(run: Path) -> str:
    """What a run's own report says of the edges that its photographs show straight."""
    figures = json.loads((run / "summary.json").read_text())
    drawn, own, photos = (figures[f"texture.edges_{name}"]["value"] for name in ("drawn", "jagged", "jagged_in_photos"))
    return f"| {run.name} | {drawn:.0f} | {own:.2f} | {photos:.2f} |"


def main(words: list[str]) -> None:
    """The page."""
    runs = [Path(word) for word in words or ["runs/volos"]]
    lines = ["# Edges of roofs in orthoimages", "", "## Against photographs that show them straight", ""]
    lines += ["| orthoimage | edges that it shows % | departure px | in photographs px |", "| --- | --- | --- | --- |"]
    lines += [
        *map(photograph_row, runs),
        "",
        "Departures from straight lines over 21 px (rms), as `texture.edges_jagged` and `texture.edges_jagged_in_photos`.",
        "",
        "## Against the true orthoimage of a simulated town",
        "",
        "| edges | pieces | rms px | median of the pieces px | beyond 2 px % | of the squares % | rms of the others px |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for run in filter(_is_simulated, runs):
        ortho, *perfect = edges_of(run)
        name, nearest = run.name, min(range(len(BLURS)), key=lambda k: perfect[k].unlike)
        lines.append(row_of(name, ortho.away))
        for k, (blur, found) in enumerate(zip(BLURS, perfect, strict=True)):
            like = ": as sharp as the orthoimage" if k == nearest else ""
            lines.append(row_of(f"{name}, the true orthoimage blurred by {blur:g} px{like}", found.away))
    lines += [
        "",
        "Departures of roof edges from their best straight line over 21 px, as `evaluation.ortho_roof_edges_jagged_px` (rms). The",
        "edges of the true orthoimage are straight: what is found on it, as sharp as photographs are, is no comb of a surface.",
    ]
    write_page("roof_edges", words, "\n".join(lines))
