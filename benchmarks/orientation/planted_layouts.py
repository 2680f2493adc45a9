"""Sixty layouts of photographs with planted blunders in every kind of observation: what converges, what is named, what is blamed
without being wrong.

    python -m benchmarks planted_layouts [seed=N] [resume] [shape ...]

Twelve shapes (strips, crosses, circles, facades, kites, corridors, caves) with five kinds of knowledge each (rough positions, good
ones, control, control at one end with rough positions, measured distances only). Geometry and noise, no pixels.
"""

import csv
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from benchmarks.instrument.result_page import RESULTS, write_page
from benchmarks.orientation.simulated_scenes import orienting, photographed_layouts, planted_blunders
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.interior_settings import FreeInterior
from orthomill.tasks.orientation.relative.pairs import relate_pairs

LEAST_MATCHES = 15
CONSTANT, DETERMINED = 1.2, 0.01
"""The planted camera constant by the true one; standard error of a free camera constant, in units of it, up to which a block is
expected to notice that."""


@dataclass(frozen=True)
class Case:
    """One adjustment: `layout`, `kind` of blunder, whether it gave a block, named the blunder and nothing else; iterations, CPU
    seconds, and what was `said` where something is amiss."""

    layout: str
    kind: str
    converged: bool
    named: bool
    clean: bool
    oriented: float
    iterations: int
    cpu: float
    said: str


def cases(shape: str, knowledge: str, seed: int) -> Iterator[Case]:
    """All adjustments of a layout."""
    block = photographed_layouts.layout(shape, knowledge, seed)
    relative = relate_pairs(block.photos, block.cameras, block.tie_points, LEAST_MATCHES)
    for one in _planted(block, relative, shape, seed):
        # Pairs are the same where only surveyed observations have a blunder.
        same = one.block.tie_points is block.tie_points and one.block.cameras is block.cameras
        yield case(f"{shape}, {knowledge}", one, relative if same else None)


def _planted(block, relative, shape: str, seed: int) -> Iterator:
    yield from planted_blunders.planted(block, photographed_layouts.scene_of(shape, seed).distance, seed)
    if _constant_is_determined(block, relative):
        yield planted_blunders.with_constant(block, CONSTANT)


def _constant_is_determined(block, relative) -> bool:
    """Whether the block by itself knows its camera constant."""
    try:
        camera = orienting.orient(block, relative=relative, interior=FreeInterior(kind="free"))["block"].cameras["cam"]
    except GeometryError:
        return False
    sigma = np.sqrt(np.array(camera.covariance)[0, 0])
    return bool(0 < sigma < DETERMINED * camera.c)


def case(layout: str, one, relative=None) -> Case:
    """The adjustment of one planted block."""
    started = time.process_time()
    try:
        out = orienting.orient(one.block, relative=relative)
    except GeometryError as error:
        return Case(layout, one.kind, False, False, True, 0.0, 0, time.process_time() - started, str(error))
    named, clean = planted_blunders.is_named(one, out), planted_blunders.nothing_else(one, out)
    said = "" if named and clean else ", ".join(sorted(planted_blunders.named_by(out))) or "nothing named"
    wanted = ", ".join(sorted(one.named))
    said = f"{said} (planted: {wanted})" if said and wanted else said
    oriented = len(out["block"].photos) / len(one.block.views)
    cpu = time.process_time() - started
    return Case(layout, one.kind, True, named, clean, oriented, out["block"].iterations, cpu, said)


def page(rows: list[Case], seed: int) -> str:
    """The page of all cases."""
    count, named = len(rows), [row for row in rows if row.kind != "none"]
    done = f"{len({row.layout for row in rows})} of {len(photographed_layouts.LAYOUTS)} layouts"
    kinds = list(dict.fromkeys(row.kind for row in rows))
    text = [
        "# Layouts with planted blunders",
        "",
        f"Seed {seed}, {done}, {count} adjustments, {sum(row.cpu for row in rows) / count:.2f} CPU-seconds each.",
        "",
        f"Converged: **{_share(row.converged for row in rows)}** (all wanted). The planted blunder named: "
        f"**{_share(row.named for row in named)}** (95 % wanted). Nothing else named: **{_share(row.clean for row in rows)}** "
        f"(99 % wanted). Iterations: median {np.median([row.iterations for row in rows]):.0f}, "
        f"most {max(row.iterations for row in rows)}.",
        "",
        "| planted | adjustments | converged | named | nothing else named | photographs oriented | most iterations |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(_row(kind, [row for row in rows if row.kind == kind]) for kind in kinds),
        "",
        "| layout | adjustments | converged | named | nothing else named | photographs oriented | most iterations |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(_row(layout, [row for row in rows if row.layout == layout]) for layout in dict.fromkeys(row.layout for row in rows)),
        "",
        f"Every case with something amiss (all cases: {_record(seed).name}):",
        "",
        *(f"- {row.layout}; {row.kind}: {row.said}" for row in rows if row.said),
    ]
    return "\n".join(text) + "\n"


def _row(name: str, rows: list[Case]) -> str:
    named = [row.named for row in rows if row.kind != "none"]
    return (
        f"| {name} | {len(rows)} | {_share(row.converged for row in rows)} | {_share(named) if named else ''} | "
        f"{_share(row.clean for row in rows)} | {100 * np.mean([row.oriented for row in rows]):.1f} % | "
        f"{max(row.iterations for row in rows)} |"
    )


def _share(values) -> str:
    found = list(values)
    return f"{100 * np.mean(found):.1f} %"


def _record(seed: int) -> Path:
    """Where the cases are kept; a page beside it has the same name."""
    return RESULTS / f"planted_layouts{f'_seed_{seed}' if seed else ''}.csv"


def rows_before(seed: int) -> list[Case]:
    """The cases of the last run."""
    if not _record(seed).exists():
        return []
    with _record(seed).open() as file:
        return [Case(*(_cell(field.type, row[field.name]) for field in fields(Case))) for row in csv.DictReader(file)]


def _cell(kind: object, text: str) -> object:
    return text == "True" if kind is bool else kind(text)


def keep(rows: list[Case], seed: int) -> None:
    """Writes every case to the record beside the page, in the order of the layouts."""
    with _record(seed).open("w", newline="") as file:
        table = csv.DictWriter(file, [field.name for field in fields(Case)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(row) for row in rows)


def main(words: list[str]) -> None:
    """Measure the layouts of the shapes named on the command line, or of all, and write the page after each; layouts of other
    shapes stay as they are, and with `resume` all that were measured before."""
    given = dict(word.split("=") for word in words if "=" in word)
    shapes = [word for word in words if "=" not in word and word != "resume"]
    seed, resume = int(given.get("seed", 0)), "resume" in words
    names = [f"{shape}, {knowledge}" for shape, knowledge in photographed_layouts.LAYOUTS]
    rows = rows_before(seed) if resume or shapes else []
    for (shape, knowledge), name in zip(photographed_layouts.LAYOUTS, names, strict=True):
        if (shapes and shape not in shapes) or (resume and any(row.layout == name for row in rows)):
            continue
        own = list(cases(shape, knowledge, seed))
        print(f"{name}: {'; '.join(f'{row.kind}: {row.said}' for row in own if row.said)}", flush=True)
        rows = sorted([row for row in rows if row.layout != name] + own, key=lambda row: names.index(row.layout))
        keep(rows, seed)
        write_page("planted_layouts", words, page(rows, seed), _record(seed).with_suffix(".md"))
