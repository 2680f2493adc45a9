"""The adjustment as tables: fit to control, checks and positions, groups of observations, largest residuals, distances, antenna."""

from orthomill.schemas.orientation import BlockPrecision, DistanceResidual, GroundResiduals, ObservationGroup, PositionDrift
from orthomill.schemas.stage_report import Grid
from orthomill.tasks.orientation.report.source_tables import source_grids

TITLES = {"control": "Ground control", "check": "Check points (took no part)", "position": "GNSS positions"}
DIFFERENCES = ("name", "dX", "dY", "dZ", "predicted sigma X", "predicted sigma Y", "predicted sigma Z")


def ground_grids(ground: GroundResiduals) -> tuple[Grid, ...]:
    """Differences at control points, check points and positions; tables without a row are left out by the report."""
    return tuple(_ground(ground, role) for role in TITLES)


def adjustment_grids(precision: BlockPrecision, distances: tuple[DistanceResidual, ...]) -> tuple[Grid, ...]:
    """The tables of the adjustment; those without a row are left out by the report."""
    return _groups(precision), _largest(precision), _distances(distances), _antenna(precision), *source_grids(precision)


def _ground(ground: GroundResiduals, role: str) -> Grid:
    # A position is no point that photographs measure.
    measured = role != "position"
    return Grid(
        title=TITLES[role],
        columns=(*DIFFERENCES, "photos", "rms px") if measured else DIFFERENCES,
        rows=tuple(
            (p.name, *p.difference, *p.predicted, *((p.photos, p.residual_px) if measured else ())) for p in ground.of_role(role)
        ),
        note="Block minus given, metres; predicted: standard error of the difference.",
    )


def _groups(precision: BlockPrecision) -> Grid:
    rows = tuple(
        # The redundancy is a sum of redundancy numbers, so it has a fraction.
        (
            ": ".join(filter(None, (g.name, g.part))),
            g.count,
            round(g.redundancy, 1),
            round(100.0 * g.redundancy / max(g.count, 1), 1),
            g.factor,
            *_found(g),
        )
        for g in precision.groups
    )
    return Grid(
        title="Groups of observations",
        columns=(
            "observations",
            "numbers observed",
            "redundancy",
            "mean redundancy number, %",
            "estimated by stated",
            "smallest error found",
            "largest of these",
            "its effect, not found",
            "unchecked",
        ),
        rows=rows,
        note="The variance components of the adjustment. Estimated by stated: the factor by which the residuals enlarge the stated "
        "standard errors; 1: they were right. Standard errors of surveyed quantities are only enlarged, and only where they "
        "contradict the rest. Redundancy number: the share of an error that shows in the residual; near 0 nothing checks the "
        "observation. Smallest error found: by a test at 0.1 % with 80 % probability, 4.13 sigma / sqrt(r), the median of the "
        "group, and of the observation that is checked worst (Baarda); px in photographs, else m. Its effect: (1 - r) times "
        "that, on the adjusted value. Unchecked: observations of which no error would be found.",
    )


def _found(group: ObservationGroup) -> tuple[float | int | None, ...]:
    known = group.reliability
    return (known.detectable, known.detectable_most, known.effect, known.unchecked) if known else (None,) * 4


def _largest(precision: BlockPrecision) -> Grid:
    rows = tuple(
        (w.point, w.photo, w.axis, w.residual_px, w.standardised, w.redundancy_number, w.detectable_px) for w in precision.largest
    )
    return Grid(
        title="Largest standardised residuals",
        columns=("point", "photo", "axis", "residual px", "in standard errors", "redundancy number", "smallest error found px"),
        rows=rows,
        note="Of the measurements that took part, the largest first: x to the right, y up. Tie points by their number in "
        "tables/orientation/image_residuals.parquet. Smallest error found: what the test at 0.1 % finds with 80 % probability "
        "(inner reliability).",
    )


def _distances(distances: tuple[DistanceResidual, ...]) -> Grid:
    return Grid(
        title="Distances",
        columns=("from", "to", "role", "measured m", "on the map m", "block minus measured m", "predicted sigma m"),
        rows=tuple((d.first, d.second, d.role, d.measured or d.length, d.length, d.difference, d.predicted) for d in distances),
    )


def _antenna(precision: BlockPrecision) -> Grid:
    """What was estimated of the receiver: the common shift of its positions, and the place of its antenna."""
    arms = [(arm.receiver or "photographs without serial number", arm.value, arm.sigma) for arm in precision.lever_arms]
    found = (
        ("common shift of the GNSS positions: X, Y, Z", precision.gnss_shift, precision.gnss_shift_sigma),
        ("antenna from the projection centre: right, up, backwards", precision.lever_arm, precision.lever_arm_sigma),
        *((f"antenna of {name}: right, up, backwards", value, sigma) for name, value, sigma in arms),
        *((_drift_of(drift), drift.value, drift.sigma) for drift in precision.drifts),
    )
    # A lever arm of zero that was not adjusted is no row: most blocks have none.
    rows = tuple((what, *value, *(sigma or (None,) * 3)) for what, value, sigma in found if value)
    return Grid(
        title="GNSS shift, lever arm and drift",
        columns=("", "1", "2", "3", "sigma 1", "sigma 2", "sigma 3"),
        rows=rows,
        note="Metres. No standard error: taken as exactly known. A drift is tested and not adjusted: what it would be as an "
        "unknown, from the first photograph of a flight to its last; empty where the block would follow all of it, as a lean.",
    )


def _drift_of(drift: PositionDrift) -> str:
    first, last = drift.photos[0], drift.photos[-1]
    return f"drift of the positions from {first} to {last} ({len(drift.photos)}, {60.0 * drift.hours:.0f} min): X, Y, Z"
