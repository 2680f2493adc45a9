"""What a surveyor reads about the block: how precise, how reliable, how well it fits what is known, and what is weak."""

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera, Cameras
from orthomill.schemas.observations import Control, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import (
    Block,
    BlockPrecision,
    ExteriorOrientation,
    GroundResidual,
    GroundResiduals,
    RelativeOrientations,
)
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import Figure, Grid, StageReport
from orthomill.tasks.geometry.survey_system import vertical_name
from orthomill.tasks.orientation.reporting.adjustment_tables import adjustment_grids
from orthomill.tasks.orientation.reporting.block_charts import block_charts
from orthomill.tasks.orientation.reporting.block_facts import CELLS, Facts, coverage, filled_areas
from orthomill.tasks.orientation.reporting.block_warnings import block_warnings
from orthomill.tasks.orientation.reporting.overlap_map import overlap_picture


def report(
    photos: Photos,
    cameras: Cameras,
    control: Control,
    relative: RelativeOrientations,
    block: Block,
    points: GroundPoints,
    image_residuals: ImageResiduals,
    ground_residuals: GroundResiduals,
    precision: BlockPrecision,
) -> StageReport:
    """The stage's report."""
    facts = Facts(photos, cameras, control, relative, block, points, image_residuals, ground_residuals, precision)
    grids = (
        _cameras(facts),
        *_interior_correlations(facts),
        _ground(facts, "control"),
        _ground(facts, "check"),
        _ground(facts, "position"),
        *adjustment_grids(precision, ground_residuals.distances),
        _per_photo(facts),
        _orientations(facts),
        _relative(facts),
        _unoriented(facts),
    )
    return StageReport(
        figures=tuple(_figures(facts)),
        grids=tuple(grid for grid in grids if grid and grid.rows),
        charts=tuple(block_charts(facts)),
        pictures=(overlap_picture(facts.block),),
        warnings=tuple(block_warnings(facts)),
    )


def _figures(facts: Facts) -> list[Figure]:
    block, precision = facts.block, facts.precision
    pixel = {camera.pixel_um for camera in block.cameras.values()}
    sigma0 = block.sigma0_px if len(facts.image) else None
    sigma0_um = sigma0 * pixel.pop() if sigma0 and len(pixel) == 1 and None not in pixel else None
    centre = np.array([_exterior_sigmas(photo)[:3] for photo in block.photos])
    fractions = coverage(facts)
    figures = [
        Figure(
            name="photos_oriented", value=len(block.photos), sentence=f"of {len(facts.photos.photos)} photographs", headline=True
        ),
        Figure(name="photos_unoriented", value=len(block.unoriented), sentence="Photographs that did not join the block."),
        Figure(name="datum", value=block.datum),
        Figure(
            name="height_reference",
            value=vertical_name(block.crs) or "not stated",
            sentence="What heights count from. Not stated: from where the heights of control or positions count; state it as the "
            "part of crs after a plus sign.",
        ),
        Figure(
            name="sigma0_px",
            value=sigma0,
            unit="px",
            headline=True,
            sentence="Standard error of an image coordinate, estimated from the residuals and their redundancy; empty for a block "
            "of another program that no tie points examine.",
        ),
        Figure(
            name="sigma0_um",
            value=sigma0_um,
            unit="micrometres",
            sentence="The same on the sensor or scan; empty when the pixel size is unknown.",
        ),
        Figure(
            name="sigma0_factor",
            value=precision.image_factor,
            sentence="Estimated by stated standard error of the image measurements.",
        ),
        Figure(
            name="common_errors_px",
            value=precision.common_px,
            unit="px",
            sentence="Displacements that whole regions of a photograph share (stabiliser, shutter, lens), from the residuals; all "
            "standard errors carry them. Empty where the residuals are white noise.",
        ),
        Figure(
            name="common_errors_of_camera",
            value=None if precision.common_share is None else 100.0 * precision.common_share,
            unit="%",
            sentence="Of their variance, the part that is the same in all photographs of a camera.",
        ),
        Figure(name="redundancy", value=block.redundancy, sentence="Numbers observed beyond those that are unknown."),
        Figure(name="iterations", value=block.iterations, sentence="Of all adjustments, those that found blunders included."),
        Figure(
            name="tie_points", value=len(facts.points), sentence="Tie points on the ground, each seen by two photographs or more."
        ),
        Figure(
            name="rays_per_point",
            value=float(facts.points.rays.mean()) if len(facts.points) else None,
            sentence="Photographs per tie point, on average.",
        ),
        Figure(name="image_measurements", value=precision.rays, sentence="Points measured in photographs that took part."),
        Figure(
            name="image_measurements_rejected",
            value=precision.rejected,
            sentence="Measurements that contradicted the others and took no part.",
        ),
        Figure(
            name="centre_sigma_plan",
            value=_median(np.hypot(centre[:, 0], centre[:, 1])),
            unit="m",
            sentence="Median standard error of the projection centres in plan.",
        ),
        Figure(name="centre_sigma_height", value=_median(centre[:, 2]), unit="m"),
        Figure(
            name="ground_sigma_plan",
            value=_median(np.hypot(facts.points.sigma_x, facts.points.sigma_y)),
            unit="m",
            sentence="Median standard error of the tie points in plan, with the effect of the orientation.",
        ),
        Figure(name="ground_sigma_height", value=_median(facts.points.sigma_z), unit="m"),
        Figure(
            name="covered_by_two",
            value=fractions[0],
            unit="%",
            sentence="Share of the photographed ground that two photographs or more see.",
        ),
        Figure(name="covered_by_three", value=fractions[1], unit="%"),
    ]
    for role, word in (("control", "control"), ("check", "check"), ("position", "gnss")):
        figures += _ground_figures(facts.ground.of_role(role), word)
    return figures


def _median(values: np.ndarray) -> float | None:
    """The median of the numbers that are known."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def _exterior_sigmas(photo: ExteriorOrientation) -> np.ndarray:
    """(6,) standard errors of X, Y, Z in m and of omega, phi, kappa in degrees; NaN where they are not known."""
    if photo.covariance is None:
        return np.full(6, np.nan)
    return np.sqrt(np.diag(np.array(photo.covariance))) * np.repeat([1.0, np.degrees(1.0)], 3)


_GROUND_WORDS = {
    "control": "at the control points, which hold the block",
    "check": "at the check points, which took no part in the adjustment",
    "gnss": "at the projection centres, whose positions were observed",
}


def _ground_figures(points: tuple[GroundResidual, ...], word: str) -> list[Figure]:
    if not points:
        return []
    difference, predicted = np.array([p.difference for p in points]), np.array([p.predicted for p in points])
    plan, height = np.sqrt((difference[:, :2] ** 2).sum(axis=1).mean()), np.sqrt((difference[:, 2] ** 2).mean())
    ratio = np.sqrt(((difference / np.maximum(predicted, 1e-9)) ** 2).mean())
    headline = word == "check"
    return [
        Figure(name=f"{word}_count", value=len(points)),
        Figure(
            name=f"{word}_rmse_plan",
            value=float(plan),
            unit="m",
            headline=headline,
            sentence=f"Root mean square difference in plan, {_GROUND_WORDS[word]}.",
        ),
        Figure(
            name=f"{word}_rmse_height",
            value=float(height),
            unit="m",
            headline=headline,
            sentence=f"The same in height, {_GROUND_WORDS[word]}.",
        ),
        Figure(
            name=f"{word}_by_predicted",
            value=float(ratio),
            sentence="Differences in units of their predicted standard errors, root mean square: about 1 when the stated precision "
            "is honest; well below, it could be stated better.",
        ),
    ]


def _cameras(facts: Facts) -> Grid:
    rows = []
    for name, camera in facts.block.cameras.items():
        before, sigma = facts.before.cameras.get(name, camera), _sigmas(camera)
        rows += [
            (name, parameter, before.interior[i], camera.interior[i], sigma[i], camera.interior[i] - before.interior[i])
            for i, parameter in enumerate(INTERIOR)
        ]
        rows.append(
            (
                name,
                "k1 in px^-2",
                before.k1 / before.c**2,
                camera.k1 / camera.c**2,
                sigma[3] / camera.c**2 if sigma[3] else None,
                None,
            )
        )
    return Grid(
        title="Cameras",
        columns=("camera", "parameter", "before", "adjusted", "standard error", "change"),
        rows=tuple(rows),
        note="c, x0, y0 in pixels. No standard error: the parameter was held fixed. A standard error without a change: the "
        "parameter was not adjusted, but its doubt was carried to all results.",
    )


def _interior_correlations(facts: Facts) -> list[Grid]:
    """One table for every camera that was adjusted."""
    grids = []
    for name, camera in facts.block.cameras.items():
        free = [i for i, sigma in enumerate(_sigmas(camera)) if sigma]
        if len(free) < 2:
            continue
        covariance = np.array(camera.covariance)[np.ix_(free, free)]
        scale = np.sqrt(np.diag(covariance))
        values = covariance / np.outer(scale, scale)
        rows = tuple((INTERIOR[i], *(round(float(v), 2) for v in values[k])) for k, i in enumerate(free))
        grids.append(
            Grid(
                title=f"Correlations of the interior orientation, camera {name}",
                columns=("", *(INTERIOR[i] for i in free)),
                rows=rows,
                note="Near 1 or -1: only the two together are known.",
            )
        )
    return grids


def _sigmas(camera: Camera) -> list[float | None]:
    if camera.source != "block" or camera.covariance is None:
        return [None] * len(INTERIOR)
    return [float(np.sqrt(v)) if v > 0 else None for v in np.diag(np.array(camera.covariance))]


def _orientations(facts: Facts) -> Grid:
    rows = []
    for photo in facts.block.photos:
        sigma = [float(v) if np.isfinite(v) else None for v in _exterior_sigmas(photo)]
        rows.append((photo.photo, *photo.centre, *sigma[:3], *photo.omega_phi_kappa, *sigma[3:]))
    return Grid(
        title="Exterior orientation",
        columns=(
            "photo",
            "X",
            "Y",
            "Z",
            "sigma X",
            "sigma Y",
            "sigma Z",
            "omega",
            "phi",
            "kappa",
            "sigma omega",
            "sigma phi",
            "sigma kappa",
        ),
        rows=tuple(rows),
        note="Metres and degrees.",
    )


def _per_photo(facts: Facts) -> Grid:
    names, rows = facts.photos.names, []
    for photo in facts.block.photos:
        own = facts.image.take((facts.image.photo == names.index(photo.photo)) & facts.image.used)
        all_own = int((facts.image.photo == names.index(photo.photo)).sum())
        rms = [float(np.sqrt((v.astype(float) ** 2).mean())) if len(v) else None for v in (own.v_col, own.v_row)]
        size = np.hypot(own.v_col, own.v_row)
        camera = facts.block.camera_of(photo.photo)
        um = photo.residual_px * camera.pixel_um if camera.pixel_um and photo.residual_px else None
        rows.append(
            (
                photo.photo,
                len(own),
                all_own - len(own),
                *rms,
                um,
                float(size.max()) if len(size) else None,
                filled_areas(own, camera),
            )
        )
    return Grid(
        title="Image residuals",
        columns=(
            "photo",
            "measurements",
            "rejected",
            "rms col px",
            "rms row px",
            "rms micrometres",
            "largest px",
            f"areas with points, of {CELLS * CELLS}",
        ),
        rows=tuple(rows),
    )


def _ground(facts: Facts, role: str) -> Grid:
    titles = {"control": "Ground control", "check": "Check points (took no part)", "position": "GNSS positions"}
    columns = ("name", "dX", "dY", "dZ", "predicted sigma X", "predicted sigma Y", "predicted sigma Z", "photos", "rms px")
    rows = tuple((p.name, *p.difference, *p.predicted, p.photos, p.residual_px) for p in facts.ground.of_role(role))
    shown = len(columns) - 2 if role == "position" else len(columns)
    return Grid(
        title=titles[role],
        columns=columns[:shown],
        rows=tuple(row[:shown] for row in rows),
        note="Block minus given, metres; predicted: standard error of the difference.",
    )


def _relative(facts: Facts) -> Grid:
    rows = tuple(
        (
            p.left,
            p.right,
            p.matches,
            p.kept,
            p.sigma0_px,
            *(p.by_bz or (None, None)),
            *p.omega_phi_kappa,
            *(p.sigma[2:] if p.sigma else (None,) * 3),
            p.intersection_deg,
            p.outcome,
        )
        for p in facts.relative.pairs
    )
    return Grid(
        title="Relative orientation of pairs",
        columns=(
            "left",
            "right",
            "matches",
            "kept",
            "sigma0 px",
            "by",
            "bz",
            "omega",
            "phi",
            "kappa",
            "sigma about x",
            "sigma about y",
            "sigma about z",
            "intersection",
            "outcome",
        ),
        rows=rows,
        note="Angles in degrees; b_y and b_z for b_x = 1, where the base lies along x.",
    )


def _unoriented(facts: Facts) -> Grid:
    return Grid(
        title="Photographs that did not join the block",
        columns=("photo", "reason"),
        rows=tuple((u.photo, u.reason) for u in facts.block.unoriented),
    )
