"""The account of the adjustment as tables: groups of observations, the residuals that fit worst, distances, shift and lever arm."""

from orthomill.schemas.orientation import BlockPrecision, DistanceResidual
from orthomill.schemas.stage_report import Grid


def adjustment_grids(precision: BlockPrecision, distances: tuple[DistanceResidual, ...]) -> tuple[Grid, ...]:
    """The tables; those without a row are left out by the report."""
    return _groups(precision), _largest(precision), _distances(distances), _antenna(precision)


def _groups(precision: BlockPrecision) -> Grid:
    rows = tuple(
        (g.name, g.count, round(g.redundancy, 1), round(100.0 * g.redundancy / max(g.count, 1), 1), g.factor)
        for g in precision.groups
    )
    return Grid(
        title="Groups of observations",
        columns=("observations", "numbers observed", "redundancy", "mean redundancy number, %", "estimated by stated"),
        rows=rows,
        note="The variance components of the adjustment. Estimated by stated: by how much the residuals make the stated standard "
        "errors larger; 1: they were right. What was surveyed is only enlarged, and only where it contradicts the rest. Redundancy "
        "number: the share of an error that shows in the residual; near 0 nothing checks the observation.",
    )


def _largest(precision: BlockPrecision) -> Grid:
    rows = tuple(
        (w.point, w.photo, w.axis, w.residual_px, w.standardised, w.redundancy_number, w.detectable_px) for w in precision.largest
    )
    return Grid(
        title="Largest standardised residuals",
        columns=("point", "photo", "axis", "residual px", "in standard errors", "redundancy number", "smallest error found px"),
        rows=rows,
        note="Of the measurements that took part, the worst first: x to the right, y up. Tie points by their number in "
        "tables/orientation/image_residuals.parquet. Smallest error found: what the test at 0.1 % finds with 80 % probability "
        "(inner reliability).",
    )


def _distances(distances: tuple[DistanceResidual, ...]) -> Grid:
    return Grid(
        title="Distances",
        columns=("from", "to", "measured m", "block minus measured m", "predicted sigma m"),
        rows=tuple((d.first, d.second, d.length, d.difference, d.predicted) for d in distances),
    )


def _antenna(precision: BlockPrecision) -> Grid:
    """What was estimated of the receiver: its common shift and where its antenna stands."""
    found = (
        ("common shift of the GNSS positions: X, Y, Z", precision.gnss_shift, precision.gnss_shift_sigma),
        ("antenna from the projection centre: right, up, backwards", precision.lever_arm, precision.lever_arm_sigma),
    )
    rows = tuple((what, *value, *(sigma or (None,) * 3)) for what, value, sigma in found if value)
    return Grid(
        title="GNSS shift and lever arm",
        columns=("", "1", "2", "3", "sigma 1", "sigma 2", "sigma 3"),
        rows=rows,
        note="Metres. No standard error: taken for exactly known.",
    )
