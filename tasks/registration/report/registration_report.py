"""What a surveyor reads about the registration of scans: precision, residuals, check points, blunders."""

from orthomill.schemas.observations import RegisteredPoints
from orthomill.schemas.stage_report import Chart, Figure, Grid, Product, StageReport, Verdict
from orthomill.tasks.registration.registered_scans import RegisteredScan, RegisteredScans, RejectedTarget, TargetResiduals
from orthomill.tasks.registration.scan_figures import check_rms, largest_residuals, mean_sigma, place_sigmas

PRODUCTS = (
    Product(path="products/scans.json", purpose="Rotation and translation of each scan with their covariance"),
    Product(path="products/registered_points.csv", purpose="All targets in the project's system with their covariance"),
    Product(path="products/scan_residuals.csv", purpose="The residuals of every target in every scan"),
)
_FEW = 4
"""Targets of a scan below which little checks it."""
_CONTRADICTED = 1.5
"""Ratio of estimated to stated standard errors from which the statement is called wrong."""


def report(scans: RegisteredScans, points: RegisteredPoints, residuals: TargetResiduals) -> StageReport:
    """The stage's report."""
    doubts = _doubts(scans)
    return StageReport(
        verdict=_verdict(scans, doubts),
        products=PRODUCTS,
        figures=_figures(scans, points),
        grids=tuple(
            grid for grid in (_scan_grid(scans), _check_grid(scans), _rejected_grid(scans), _worst_grid(residuals)) if grid.rows
        ),
        charts=(_map(scans, points),),
        warnings=(*doubts, *_warnings(scans)),
        doubts=doubts,
    )


def _verdict(scans: RegisteredScans, doubts: tuple[str, ...]) -> Verdict:
    told = (
        f"{len(scans.scans)} scans are registered; a coordinate of a target has a standard error of {1000 * scans.sigma0_m:.1f} mm."
    )
    return Verdict(level="fair" if doubts else "good", sentence=told)


def _figures(scans: RegisteredScans, points: RegisteredPoints) -> tuple[Figure, ...]:
    away = check_rms(scans)
    return (
        Figure(name="scans", value=len(scans.scans), headline=True),
        Figure(
            name="sigma0",
            value=round(1000 * scans.sigma0_m, 3),
            unit="mm",
            sentence="Standard error of a coordinate of a target in a scan, from the residuals.",
            headline=True,
        ),
        Figure(name="redundancy", value=scans.redundancy),
        Figure(name="control_points", value=scans.control, sentence="Surveyed targets that took part."),
        Figure(name="tie_points", value=scans.tie, sentence="Targets in two or more scans that were not surveyed."),
        Figure(
            name="point_sigma",
            value=round(1000 * mean_sigma(points), 3),
            unit="mm",
            sentence="Of a registered coordinate, on average.",
        ),
        Figure(name="rejected", value=len(scans.rejected), sentence="Targets that contradict the others."),
        Figure(name="datum", value=scans.datum, sentence="Control, or the scan that defines the system."),
        Figure(
            name="scan_factor", value=round(scans.scan_factor, 3), sentence="Estimated over stated standard errors.", detail=True
        ),
        Figure(name="control_factor", value=round(scans.control_factor, 3), sentence="The same of control.", detail=True),
        Figure(
            name="check_rms",
            value=None if away is None else round(1000 * away, 3),
            unit="mm",
            sentence="Check points: registered minus surveyed.",
        ),
    )


def _doubts(scans: RegisteredScans) -> tuple[str, ...]:
    """What one must know before one believes the registration."""
    found = []
    if scans.control_factor > 1.0:
        found.append(
            f"The control points contradict the scans: their standard errors had to be enlarged {scans.control_factor:.1f} times; "
            "look for points that were moved or surveyed in another system, or state larger standard errors."
        )
    if scans.scan_factor > _CONTRADICTED:
        found.append(
            f"Targets agree {scans.scan_factor:.1f} times worse than their standard errors say; the precision given here follows "
            "the residuals. State larger standard errors, or look at the scans with the largest residuals."
        )
    return tuple(found)


def _warnings(scans: RegisteredScans) -> tuple[str, ...]:
    few = [f"{scan.name} ({scan.targets})" for scan in scans.scans if scan.targets < _FEW]
    said = [_rejected_sentence(target) for target in scans.rejected]
    if few:
        said.append(f"Little checks the place of {', '.join(few)}: fewer than {_FEW} targets are left there; measure more.")
    return tuple(said)


def _rejected_sentence(target: RejectedTarget) -> str:
    how = f"by about {1000 * target.size_m:.0f} mm ({target.misfit:.0f} standard errors)"
    if not target.scans:
        return f"Target {target.name}: its control coordinates contradict the scans {how} and were not used."
    if len(target.scans) > 1:
        return f"Target {target.name}: {' and '.join(target.scans)} contradict each other {how}; nothing tells which one is wrong."
    return f"Target {target.name} in {target.scans[0]} contradicts the others {how} and was not used: wrong name, or it was moved."


def _scan_grid(scans: RegisteredScans) -> Grid:
    columns = (
        "scan", "X (m)", "Y (m)", "Z (m)", "omega (deg)", "phi (deg)", "kappa (deg)",
        "sigma X (mm)", "sigma Y (mm)", "sigma Z (mm)", "targets", "rms (mm)",
    )  # fmt: skip
    rows = tuple(_scan_row(scan) for scan in scans.scans)
    return Grid(
        title="Registered scans",
        columns=columns,
        rows=rows,
        note="X = R x + t: t is the scan's origin in the project's system, omega, phi and kappa are the angles of R.",
    )


def _scan_row(scan: RegisteredScan) -> tuple[float | int | str | None, ...]:
    return (
        scan.name,
        *(round(value, 4) for value in scan.translation),
        *(round(value, 5) for value in scan.omega_phi_kappa),
        *(round(1000 * value, 2) for value in place_sigmas(scan)),
        scan.targets,
        round(1000 * scan.rms_m, 2),
    )


def _check_grid(scans: RegisteredScans) -> Grid:
    rows = tuple(
        (point.name, *(round(1000 * v, 2) for v in point.difference), *(round(1000 * s, 2) for s in point.sigma))
        for point in scans.checked
    )
    columns = ("check point", "dX (mm)", "dY (mm)", "dZ (mm)", "sigma X (mm)", "sigma Y (mm)", "sigma Z (mm)")
    return Grid(title="Check points: registered minus surveyed", columns=columns, rows=rows)


def _rejected_grid(scans: RegisteredScans) -> Grid:
    rows = tuple(
        (target.name, ", ".join(target.scans) or "control", round(1000 * target.size_m, 1), target.misfit)
        for target in scans.rejected
    )
    return Grid(title="Targets that were rejected", columns=("target", "where", "size (mm)", "standard errors"), rows=rows)


def _worst_grid(residuals: TargetResiduals) -> Grid:
    """The twenty largest residuals."""
    worst = largest_residuals(residuals, 20)
    rows = tuple(
        (
            str(residuals.name[i]),
            str(residuals.scan[i]),
            *(round(1000 * float(v[i]), 2) for v in (residuals.v_x, residuals.v_y, residuals.v_z)),
            round(float(residuals.standardised[i]), 2),
        )
        for i in worst
    )
    columns = ("target", "scan", "v x (mm)", "v y (mm)", "v z (mm)", "standard errors")
    return Grid(title="Largest residuals", columns=columns, rows=rows, note="Adjusted minus scanned, along the axes of the scan.")


def _map(scans: RegisteredScans, points: RegisteredPoints) -> Chart:
    return Chart(
        title="Scans and targets",
        style="map",
        x_label="X (m)",
        y_label="Y (m)",
        x=(*(scan.translation[0] for scan in scans.scans), *points.x.tolist()),
        series={"y": (*(scan.translation[1] for scan in scans.scans), *points.y.tolist())},
        labels=(*(scan.name for scan in scans.scans), *points.name.tolist()),
    )
