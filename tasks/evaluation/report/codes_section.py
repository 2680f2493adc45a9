"""What the codes of the heights are worth, in the report: accuracy and honesty by code and class, and the edges of roofs; and
where the check could judge."""

from collections.abc import Iterator

from orthomill.schemas.stage_report import Figure, Grid
from orthomill.tasks.evaluation.accuracy import SIGMAS
from orthomill.tasks.evaluation.report.report_section import ReportSection
from orthomill.tasks.evaluation.tile_sums import CheckSummary, CodeMeasures, CrownShares, EdgeShares, HeightsSummary, rounded

_PLACES = ("all", "open_ground", "roof", "building_margin", "tree", "water", "vehicle", "wire")
"""groups of classes that are told apart by code; finer ones have too few cells of the rare codes"""
_TOGETHER = ("measured", "all_codes")
_MAIN = ("share", "nmad", "beyond_1_m", "within_2_sigma", "beyond_4_sigma", "within_2_relative_sigma", "beyond_4_relative_sigma")
"""measures of a single code, and of the surface before its check"""

_MEASURES = (
    ("share", "%", "of the cells visible in two photographs or more have such a height", "share %"),
    ("heights", "", "number of heights", "heights"),
    ("bias", "m", "mean difference from the reference", "bias"),
    ("nmad", "m", "normalised median absolute deviation", "NMAD"),
    ("beyond_1_m", "%", "differ by more than 1 m", "> 1 m"),
    ("beyond_1_cell", "%", "differ by more than one cell", "> 1 cell"),
    ("within_1_sigma", "%", "within 1 of their own standard errors", "< 1 s"),
    ("within_2_sigma", "%", "within 2 of their own standard errors", "< 2 s"),
    ("within_3_sigma", "%", "within 3 of their own standard errors", "< 3 s"),
    ("beyond_4_sigma", "%", "beyond 4 of their own standard errors", "> 4 s"),
    ("beyond_5_sigma", "%", "beyond 5 of their own standard errors", "> 5 s"),
    ("within_1_relative_sigma", "%", "within 1 of their standard errors among neighbours, without the datum's error", "< 1 r"),
    ("within_2_relative_sigma", "%", "within 2 of their standard errors among neighbours, without the datum's error", "< 2 r"),
    ("beyond_4_relative_sigma", "%", "beyond 4 of their standard errors among neighbours, without the datum's error", "> 4 r"),
)
"""name, unit, meaning, and head of its column"""


_CROWN_MEASURES = (
    ("at_crown", "within 1 m of the crown", "crown %"),
    ("at_ground", "within 1 m of the ground below the crown, seen through it", "ground below %"),
    ("at_neither", "at neither of the two", "neither %"),
    ("nearer_within_2", "within 2 of their standard errors among neighbours of crown or ground, whichever is nearer", "< 2 r"),
    ("nearer_beyond_4", "beyond 4 of their standard errors among neighbours of both crown and ground", "> 4 r"),
)
"""name, meaning, and head of its column"""


def _values(row: CodeMeasures) -> dict[str, float | None]:
    """The values of _MEASURES."""
    within, relative = (dict(zip(SIGMAS, shares, strict=True)) for shares in (row.within, row.within_relative))
    return {
        **{name: row.numbers[name] for name in ("share", "heights", "bias", "nmad")},
        "beyond_1_m": row.numbers["beyond_metre"],
        "beyond_1_cell": row.numbers["beyond_cell"],
        **{f"within_{k:.0f}_sigma": within[k] for k in (1.0, 2.0, 3.0)},
        **{f"beyond_{k:.0f}_sigma": _rest(within[k]) for k in (4.0, 5.0)},
        **{f"within_{k:.0f}_relative_sigma": relative[k] for k in (1.0, 2.0)},
        "beyond_4_relative_sigma": _rest(relative[4.0]),
    }


def _rest(share: float | None) -> float | None:
    """What is not within."""
    return None if share is None else rounded(100.0 - share, 2)


def code_figures(prefix: str, summary: HeightsSummary, full: bool) -> Iterator[Figure]:
    """Figures `<prefix>_<code>_<group>_<measure>`; the group `all` has no name of its own. `full`: single codes too."""
    for row in summary.codes:
        together = row.code in _TOGETHER
        if row.place not in _PLACES or not (together or full):
            continue
        head = f"{prefix}_{row.code}" if row.place == "all" else f"{prefix}_{row.code}_{row.place}"
        values = _values(row)
        for name, unit, words, _ in _MEASURES:
            if name in _MAIN or (together and full):
                yield Figure(name=f"{head}_{name}", value=values[name], unit=unit, sentence=f"{_capital(row.words)}: {words}.")
    for edge in summary.edges:
        if edge.code in _TOGETHER:
            yield from _edge_figures(prefix, edge)
    for crowns in summary.crowns:
        if full and crowns.code != "all_codes":
            yield from _crown_figures(prefix, crowns)


def _crown_figures(prefix: str, crowns: CrownShares) -> Iterator[Figure]:
    for name, words, _ in _CROWN_MEASURES:
        sentence = f"{_capital(crowns.words)}, trees: {words}."
        yield Figure(name=f"{prefix}_{crowns.code}_tree_{name}", value=crowns.numbers[name], unit="%", sentence=sentence)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _edge_figures(prefix: str, edge: EdgeShares) -> Iterator[Figure]:
    pairs = (
        ("roofs_grown", edge.grown, "cells of ground within 3 cells of a roof whose height is closer to the roof's"),
        ("roofs_lost", edge.lost, "outermost cells of roofs whose height is closer to the ground's"),
    )
    for name, value, words in pairs:
        yield Figure(name=f"{prefix}_{edge.code}_{name}", value=value, unit="%", sentence=f"{_capital(edge.words)}: {words}.")


def code_grids(title: str, summary: HeightsSummary) -> tuple[Grid, ...]:
    """Tables of the heights by code and class, of the edges of roofs and of trees; none where nothing has a height."""
    rows = [row for row in summary.codes if row.place in _PLACES]
    if not rows:
        return ()
    codes = Grid(
        title=f"{title}: heights by code and class",
        columns=("heights", *(head for *_, head in _MEASURES)),
        rows=tuple((row.words, *(_values(row)[name] for name, *_ in _MEASURES)) for row in rows),
        note="Cells visible in two photographs or more. Lengths in m, shares in %; s: the height's own standard error, r: that "
        "among neighbours, after the error of the datum is taken off (a normal law has 68.3, 95.4 and 99.7 within 1, 2 and 3).",
    )
    edges = Grid(
        title=f"{title}: edges of roofs",
        columns=("heights", "ground that got the roof's height %", "roof that got the ground's height %"),
        rows=tuple((edge.words, edge.grown, edge.lost) for edge in summary.edges),
        note="Ground within 3 cells of a roof and the outermost cells of roofs, where the roof stands two cells or more higher.",
    )
    crowns = Grid(
        title=f"{title}: trees, through which the ground is seen",
        columns=("heights", *(head for *_, head in _CROWN_MEASURES)),
        rows=tuple((row.words, *(row.numbers[name] for name, *_ in _CROWN_MEASURES)) for row in summary.crowns),
        note="Cells visible in two photographs or more. All other figures compare with the crown alone. r: the standard error "
        "among neighbours, from the nearer one of the two surfaces.",
    )
    return (codes, *([edges] if summary.edges else []), *([crowns] if summary.crowns else []))


def check_section(summary: CheckSummary) -> ReportSection:
    """Which share of the measured heights the check judged, by class of the truth, and what it said."""
    figures = tuple(
        Figure(
            name=f"check_judged_{group.name}" if group.name != "all" else "check_judged",
            value=group.judged,
            unit="%",
            sentence=f"Measured heights that the check of the surface could judge, {group.words}.",
        )
        for group in summary.groups
    )
    grid = Grid(
        title="The check of the surface by class of ground",
        columns=("where", "measured cells", "judged %", "of these called wrong %", "disputed %"),
        rows=tuple((group.words, group.cells, group.judged, group.wrong, group.disputed) for group in summary.groups),
        note="What is not judged is hidden from one photograph of every pair, has no texture, or differs from photograph to "
        "photograph.",
    )
    return ReportSection(figures=figures, grids=(grid,) if summary.groups else ())
