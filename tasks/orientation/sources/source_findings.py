"""What is told of the sources of a block: offsets that were adjusted, a unit of the control, contradictions without a cause."""

from collections.abc import Iterator

import numpy as np

from orthomill.schemas.findings.block_findings import (
    BlockFinding,
    ControlContradicted,
    DatumMisfit,
    OffsetAdjusted,
    PositionContradicted,
    PositionsAlongView,
    PositionsElsewhere,
    SourcesDisagree,
    UnitContradicted,
)
from orthomill.schemas.orientation import PositionOffset, SourceStatement
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.orientation.sources.block_sources import BlockSources
from orthomill.tasks.orientation.sources.evidence import Source
from orthomill.tasks.orientation.sources.source_table import Said

SOURCES = {
    Source.PLAN: "positions in plan",
    Source.HEIGHT: "positions in height",
    Source.CONTROL: "control",
    Source.ATTITUDE: "attitudes",
    None: "given camera constant",
}
DEGREE, PERCENT = float(np.degrees(1.0)), 100.0
PARAMETERS = (
    ("shift in X", "m", 1.0),
    ("shift in Y", "m", 1.0),
    ("shift in height", "m", 1.0),
    ("tilt about X", "degrees", DEGREE),
    ("tilt about Y", "degrees", DEGREE),
    ("azimuth", "degrees", DEGREE),
    ("scale", "%", PERCENT),
)
"""Name, unit and factor into that unit of the parameters of the motion"""
CONTRADICTED = 3.0
"""Standard errors beyond which a source contradicts the others"""
PIXELS = 5.0
"""Shifts of so many pixels on the ground matter."""
MATTERS = {"degrees": 1.0, "%": 1.0}
"""Differences that matter, in the unit of the parameter"""


def source_statements(sources: BlockSources | None, cameras: tuple[str, ...]) -> tuple[SourceStatement, ...]:
    """The table of what each source says; `cameras`: names by number."""
    return tuple(_statement(said, cameras) for said in sources.table) if sources else ()


def _statement(said: Said, cameras: tuple[str, ...]) -> SourceStatement:
    motion = len(PARAMETERS)
    of_camera = (f"camera constant of {cameras[said.parameter - motion]}", "%", PERCENT) if said.parameter >= motion else None
    name, unit, factor = of_camera or PARAMETERS[said.parameter]
    known = bool(np.isfinite(said.others_sigma))
    return SourceStatement(
        source=SOURCES[said.source],
        parameter=name,
        unit=unit,
        value=factor * said.value,
        sigma=factor * said.sigma,
        others=factor * said.others if known else None,
        others_sigma=factor * said.others_sigma if known else None,
    )


def disagreements(statements: tuple[SourceStatement, ...], pixel: float) -> Iterator[SourcesDisagree]:
    """The largest contradiction of every parameter that is neither chance nor too small to matter; `pixel` m on the ground."""
    worst: dict[str, SourceStatement] = {}
    for row in statements:
        if row.others is None or row.others_sigma is None or row.ratio is None:
            continue
        matters = abs(row.value - row.others) > MATTERS.get(row.unit, PIXELS * pixel)
        before = worst[row.parameter].ratio if row.parameter in worst else CONTRADICTED
        if matters and row.ratio > (before or 0.0):
            worst[row.parameter] = row
    for row in worst.values():
        yield SourcesDisagree(**row.model_dump())


def contradicted_sources(sources: BlockSources | None, statements: tuple[SourceStatement, ...]) -> tuple[BlockFinding, ...]:
    """What the sources of the block as adjusted contradict each other in."""
    if sources is None:
        return ()
    units = tuple(unit_findings(sources))
    return units or tuple(disagreements(statements, sources.block.pixel))


def unit_findings(sources: BlockSources) -> Iterator[UnitContradicted]:
    """The unit in which the control fits, where that is not metres."""
    unit, block = sources.found.unit, sources.block
    if unit is None:
        return
    placed = np.isfinite(block.control).all(axis=1)
    here = block.moved(sources.found.after.motion).control[placed, 2]
    misfits = (np.abs(told.control[placed, 2] - here) for told in (sources.told, sources.found.told))
    given, fits = (float(np.median(misfit)) for misfit in misfits)
    yield UnitContradicted(unit=unit.name, heights_only=unit.heights_only, given_m=given, fits_m=fits)


def offsets_of(result: Adjustment, names: tuple[str, ...]) -> tuple[PositionOffset, ...]:
    """The shifts of the positions that were adjusted, one by one."""
    sigma, rows = np.sqrt(result.cofactor.variances[result.network.shift_columns]), []
    for number in range(result.network.shifts):
        photos, axes = np.nonzero(result.network.shift == number)
        rows.append(
            PositionOffset(
                photos=tuple(names[i] for i in photos),
                axis=int(axes[0]),
                value=float(result.state.shift[number]),
                sigma=float(sigma[number]),
            )
        )
    return tuple(rows)


def offset_findings(
    offsets: tuple[PositionOffset, ...], before: BlockSources, names: tuple[str, ...], heights: str | None
) -> Iterator[OffsetAdjusted]:
    """One finding for every group of positions that has offsets; `before`: the sources of the block without them."""
    motion = before.found.after.motion
    moved = float(np.linalg.norm(before.block.moved(motion).centre - before.block.centre, axis=1).max())
    positioned = {name for name, has in zip(names, before.told.positioned, strict=True) if has}
    for photos in dict.fromkeys(offset.photos for offset in offsets):
        own = {offset.axis: offset for offset in offsets if offset.photos == photos}
        by_scatter = before.offset_sigmas(np.isin(names, photos))
        yield OffsetAdjusted(
            photos=photos,
            against="control" if positioned <= set(photos) else "others",
            offset=_by_axis({axis: offset.value for axis, offset in own.items()}),
            sigma=_by_axis({axis: by_scatter.get(axis, offset.sigma) for axis, offset in own.items()}),
            tilt_deg=float(np.degrees(np.linalg.norm(motion[3:5]))),
            moved_m=moved,
            heights=heights,
        )


def _by_axis(values: dict[int, float]) -> tuple[float | None, float | None, float | None]:
    return values.get(0), values.get(1), values.get(2)


def covered_by(findings: tuple[BlockFinding, ...]) -> tuple[type, ...]:
    """The kinds of findings that only describe what one of `findings` names the cause of."""
    if any(isinstance(finding, UnitContradicted) for finding in findings):
        # In another unit every control point looks wrong, and the right ones most.
        return DatumMisfit, PositionsElsewhere, PositionsAlongView, ControlContradicted, PositionContradicted
    offset = any(isinstance(finding, OffsetAdjusted) for finding in findings)
    return (DatumMisfit, PositionsElsewhere, PositionsAlongView) if offset else ()
