"""What each source says of the block, as tables and figures."""

from collections.abc import Iterator

from orthomill.schemas.errors import some_of
from orthomill.schemas.orientation import BlockPrecision, SourceStatement
from orthomill.schemas.stage_report import Figure, Grid

COORDINATES = ("X", "Y", "height")


def source_grids(precision: BlockPrecision) -> tuple[Grid, ...]:
    """The table of what each source says, and that of the constant errors of positions; without rows the report leaves them out."""
    return _statements(precision.sources), _offsets(precision)


def _statements(sources: tuple[SourceStatement, ...]) -> Grid:
    # What nothing else determines cannot be compared, and says nothing about the block.
    compared = [s for s in sources if s.ratio is not None]
    return Grid(
        title="What each source says",
        columns=("source", "parameter", "unit", "value", "standard error", "all others", "their standard error", "ratio"),
        rows=tuple((s.source, s.parameter, s.unit, s.value, s.sigma, s.others, s.others_sigma, s.ratio) for s in compared),
        note="By how much the block would have to change for a source alone to be right, and for all others without it. Attitudes "
        "turn with their mounting, positions share an error as large as is stated of them; both are in the standard errors. "
        "Bend: from the middle of the block to its ends. Height of a flight: by its own positions. Ratio: their difference in "
        "standard errors; beyond 3 sources contradict each other.",
    )


def _offsets(precision: BlockPrecision) -> Grid:
    return Grid(
        title="Constant errors of positions",
        columns=("photographs", "coordinate", "offset m", "standard error m"),
        rows=tuple((some_of(o.photos), COORDINATES[o.axis], o.value, o.sigma) for o in precision.offsets),
        note="Given minus block, adjusted as unknowns because the sources contradict each other without them.",
    )


def source_figures(precision: BlockPrecision) -> Iterator[Figure]:
    """The largest contradiction between the sources, and the largest constant error of positions."""
    ratios = [row.ratio for row in precision.sources if row.ratio is not None]
    yield Figure(
        name="sources_largest_ratio",
        label="Largest contradiction between sources",
        value=max(ratios, default=None),
        sentence="Of all parameters of place, tilt, scale and camera constant: what a source says against all others, in standard "
        "errors of the difference. Beyond 3 sources contradict each other.",
    )
    yield Figure(name="position_offsets", value=len(precision.offsets), sentence="Constant errors of positions that were adjusted.")
    largest = max(precision.offsets, key=lambda offset: abs(offset.value), default=None)
    yield Figure(
        name="position_offset_largest",
        value=largest.value if largest else None,
        unit="m",
        sentence="The largest of them, given minus block.",
    )
    yield Figure(
        name="position_offset_largest_sigma", value=largest.sigma if largest else None, unit="m", sentence="Its standard error."
    )
