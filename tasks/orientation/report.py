"""What a surveyor reads about the block: how precise, how reliable, how well it fits what is known, and what is weak."""

from dataclasses import dataclass

import numpy as np

from schemas.camera import INTERIOR, Camera, Cameras
from schemas.observations import Control, GroundPoints, ImageResiduals
from schemas.orientation import Block, BlockPrecision, GroundResidual, GroundResiduals, RelativeOrientations
from schemas.photo import Photos
from schemas.report import Chart, Figure, Grid, StageReport
from tasks.geometry.view import block_view

CELLS = 3
"""Each photograph is divided into CELLS x CELLS areas (von Gruber) to judge the distribution of its tie points."""


@dataclass(frozen=True, eq=False)
class _Facts:
    photos: Photos
    before: Cameras
    control: Control
    relative: RelativeOrientations
    block: Block
    points: GroundPoints
    image: ImageResiduals
    ground: GroundResiduals
    precision: BlockPrecision


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
    facts = _Facts(photos, cameras, control, relative, block, points, image_residuals, ground_residuals, precision)
    grids = (
        _cameras(facts),
        _orientations(facts),
        _per_photo(facts),
        _ground(facts, "control"),
        _ground(facts, "check"),
        _ground(facts, "position"),
        _relative(facts),
        _unoriented(facts),
    )
    return StageReport(
        figures=tuple(_figures(facts)),
        grids=tuple(grid for grid in grids if grid and grid.rows),
        charts=tuple(_charts(facts)),
        warnings=tuple(_warnings(facts)),
    )


def _figures(facts: _Facts) -> list[Figure]:
    block, precision = facts.block, facts.precision
    pixel = {camera.pixel_um for camera in block.cameras.values()}
    sigma0_um = block.sigma0_px * pixel.pop() if len(pixel) == 1 and None not in pixel else None
    centre = np.array([np.sqrt(np.diag(photo.covariance)[:3]) for photo in block.photos])
    fractions = _coverage(facts)
    figures = [
        Figure(
            name="photos_oriented", value=len(block.photos), sentence=f"of {len(facts.photos.photos)} photographs", headline=True
        ),
        Figure(name="photos_unoriented", value=len(block.unoriented)),
        Figure(name="datum", value=block.datum),
        Figure(
            name="sigma0_px",
            value=block.sigma0_px,
            unit="px",
            headline=True,
            sentence="Standard error of an image coordinate, estimated from the residuals and their redundancy.",
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
        Figure(name="redundancy", value=block.redundancy),
        Figure(name="iterations", value=block.iterations),
        Figure(
            name="tie_points", value=len(facts.points), sentence="Tie points on the ground, each seen by two photographs or more."
        ),
        Figure(name="rays_per_point", value=float(facts.points.rays.mean()) if len(facts.points) else None),
        Figure(name="image_measurements", value=precision.rays),
        Figure(name="image_measurements_rejected", value=precision.rejected),
        Figure(
            name="centre_sigma_plan",
            value=float(np.median(np.hypot(centre[:, 0], centre[:, 1]))),
            unit="m",
            sentence="Median standard error of the projection centres in plan.",
        ),
        Figure(name="centre_sigma_height", value=float(np.median(centre[:, 2])), unit="m"),
        Figure(
            name="ground_sigma_plan",
            value=float(np.median(np.hypot(facts.points.sigma_x, facts.points.sigma_y))),
            unit="m",
            sentence="Median standard error of the tie points in plan, with the effect of the orientation.",
        ),
        Figure(name="ground_sigma_height", value=float(np.median(facts.points.sigma_z)), unit="m"),
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


def _ground_figures(points: tuple[GroundResidual, ...], word: str) -> list[Figure]:
    if not points:
        return []
    difference, predicted = np.array([p.difference for p in points]), np.array([p.predicted for p in points])
    plan, height = np.sqrt((difference[:, :2] ** 2).sum(axis=1).mean()), np.sqrt((difference[:, 2] ** 2).mean())
    ratio = np.sqrt(((difference / np.maximum(predicted, 1e-9)) ** 2).mean())
    headline = word == "check"
    return [
        Figure(name=f"{word}_count", value=len(points)),
        Figure(name=f"{word}_rmse_plan", value=float(plan), unit="m", headline=headline),
        Figure(name=f"{word}_rmse_height", value=float(height), unit="m", headline=headline),
        Figure(
            name=f"{word}_by_predicted",
            value=float(ratio),
            sentence="Differences in units of their predicted standard errors, root mean square: "
            "about 1 when the precision is honest.",
        ),
    ]


def _cameras(facts: _Facts) -> Grid:
    rows = []
    for name, camera in facts.block.cameras.items():
        before, sigma = facts.before.cameras[name], _sigmas(camera)
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
        note="c, x0, y0 in pixels. No standard error: the parameter was held fixed.",
    )


def _sigmas(camera: Camera) -> list[float | None]:
    if camera.source != "block" or camera.covariance is None:
        return [None] * len(INTERIOR)
    return [float(np.sqrt(v)) if v > 0 else None for v in np.diag(np.array(camera.covariance))]


def _orientations(facts: _Facts) -> Grid:
    rows = []
    for photo in facts.block.photos:
        sigma = np.sqrt(np.diag(np.array(photo.covariance)))
        rows.append(
            (photo.photo, *photo.centre, *map(float, sigma[:3]), *photo.omega_phi_kappa, *(float(v) for v in np.degrees(sigma[3:])))
        )
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


def _per_photo(facts: _Facts) -> Grid:
    names, rows = facts.photos.names, []
    for photo in facts.block.photos:
        own = facts.image.take((facts.image.photo == names.index(photo.photo)) & facts.image.used)
        all_own = int((facts.image.photo == names.index(photo.photo)).sum())
        rms = [float(np.sqrt((v.astype(float) ** 2).mean())) if len(v) else None for v in (own.v_col, own.v_row)]
        size = np.hypot(own.v_col, own.v_row)
        camera = facts.block.camera_of(photo.photo)
        um = photo.residual_px * camera.pixel_um if camera.pixel_um and photo.residual_px else None
        rows.append(
            (photo.photo, len(own), all_own - len(own), *rms, um, float(size.max()) if len(size) else None, _filled(own, camera))
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


def _filled(own: ImageResiduals, camera: Camera) -> int:
    """How many of the areas of a frame hold tie points."""
    col = np.clip((own.col / camera.width * CELLS).astype(int), 0, CELLS - 1)
    row = np.clip((own.row / camera.height * CELLS).astype(int), 0, CELLS - 1)
    return len(np.unique(row * CELLS + col))


def _ground(facts: _Facts, role: str) -> Grid:
    titles = {"control": "Ground control", "check": "Check points (took no part)", "position": "GNSS positions"}
    rows = tuple((p.name, *p.difference, *p.predicted, p.photos, p.residual_px) for p in facts.ground.of_role(role))
    return Grid(
        title=titles[role],
        columns=("name", "dX", "dY", "dZ", "predicted sigma X", "predicted sigma Y", "predicted sigma Z", "photos", "rms px"),
        rows=rows,
        note="Block minus given, metres; predicted: standard error of the difference.",
    )


def _relative(facts: _Facts) -> Grid:
    rows = tuple(
        (
            f"{p.left} - {p.right}",
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
            "pair",
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


def _unoriented(facts: _Facts) -> Grid:
    return Grid(
        title="Photographs that did not join the block",
        columns=("photo", "reason"),
        rows=tuple((u.photo, u.reason) for u in facts.block.unoriented),
    )


def _charts(facts: _Facts) -> list[Chart]:
    charts = [_histogram(facts), *(_arrows(facts, name) for name in facts.block.cameras), _map(facts)]
    if facts.ground.of_role("check"):
        charts.append(_check_chart(facts))
    return [chart for chart in charts if chart]


def _histogram(facts: _Facts) -> Chart:
    used = facts.image.used
    limit = max(4.0 * facts.block.sigma0_px, 1e-6)
    edges = np.linspace(-limit, limit, 41)
    counts = {
        name: tuple(map(float, np.histogram(v[used], edges)[0]))
        for name, v in (("col", facts.image.v_col), ("row", facts.image.v_row))
    }
    return Chart(
        title="Image residuals",
        style="bars",
        x_label="residual, px",
        y_label="measurements",
        x=tuple(map(float, 0.5 * (edges[1:] + edges[:-1]))),
        series=counts,
        caption="Of the measurements that took part; a normal law centred on zero is expected.",
    )


def _arrows(facts: _Facts, name: str) -> Chart | None:
    """Mean residual in a grid of areas over the frame: what the camera model leaves unexplained."""
    camera = facts.block.cameras[name]
    numbers = [facts.photos.names.index(photo) for photo, own in facts.block.of_photo.items() if own == name]
    own = facts.image.take(facts.image.used & np.isin(facts.image.photo, numbers))
    if not len(own):
        return None
    bins = 12
    col, row = ((v / size * bins).astype(int).clip(0, bins - 1) for v, size in ((own.col, camera.width), (own.row, camera.height)))
    cell = row * bins + col
    count = np.bincount(cell, minlength=bins * bins)
    keep = np.flatnonzero(count >= 3)
    dx, dy = (np.bincount(cell, v, minlength=bins * bins)[keep] / count[keep] for v in (own.v_col, own.v_row))
    return Chart(
        title=f"Mean image residuals over the frame, camera {name}",
        style="arrows",
        x_label="col, px",
        y_label="row, px",
        x=tuple(float(v) for v in (keep % bins + 0.5) * camera.width / bins),
        series={
            "y": tuple(float(v) for v in (keep // bins + 0.5) * camera.height / bins),
            "dx": tuple(map(float, dx)),
            "dy": tuple(map(float, dy)),
        },
        caption=f"Arrows are exaggerated; the longest is {np.hypot(dx, dy).max() if len(dx) else 0:.2f} px. A pattern means "
        "that the camera model does not fit the lens.",
    )


def _map(facts: _Facts) -> Chart:
    centres = [(photo.photo, *photo.centre[:2]) for photo in facts.block.photos]
    named = centres + [(point.name, *point.xyz[:2]) for point in facts.control.points]
    return Chart(
        title="Projection centres and ground points",
        style="map",
        x_label="X, m",
        y_label="Y, m",
        x=tuple(float(x) for _, x, _ in named),
        series={"y": tuple(float(y) for _, _, y in named)},
        labels=tuple(name for name, _, _ in named),
    )


def _check_chart(facts: _Facts) -> Chart:
    place = {point.name: point.xyz for point in facts.control.points}
    points = facts.ground.of_role("check")
    return Chart(
        title="Check points: differences in plan",
        style="arrows",
        x_label="X, m",
        y_label="Y, m",
        x=tuple(place[p.name][0] for p in points),
        series={
            "y": tuple(place[p.name][1] for p in points),
            "dx": tuple(p.difference[0] for p in points),
            "dy": tuple(p.difference[1] for p in points),
        },
        caption="Block minus given; arrows are exaggerated.",
    )


def _coverage(facts: _Facts) -> tuple[float, float]:
    """Percent of the photographed ground (a grid at mean height under the block) that two and three photographs see."""
    height = 0.5 * (facts.block.ground_low + facts.block.ground_high)
    views = [block_view(facts.block, name) for name in facts.block.names]
    corners = np.vstack(
        [
            v.at_height(
                np.array(
                    [[0, 0], [v.camera.width - 1, 0], [0, v.camera.height - 1], [v.camera.width - 1, v.camera.height - 1]], float
                ),
                height,
            )
            for v in views
        ]
    )
    corners = corners[np.isfinite(corners).all(axis=1)]
    if not len(corners):
        return 0.0, 0.0
    x, y = (np.linspace(corners[:, k].min(), corners[:, k].max(), 60) for k in (0, 1))
    ground = np.stack([*np.meshgrid(x, y), np.full((60, 60), height)], axis=-1).reshape(-1, 3)
    count = np.sum([v.contains(v.project(ground)) for v in views], axis=0)
    seen = max(int((count >= 1).sum()), 1)
    return float(100.0 * (count >= 2).sum() / seen), float(100.0 * (count >= 3).sum() / seen)


def _warnings(facts: _Facts) -> list[str]:
    return [
        *(u.reason for u in facts.block.unoriented),
        *facts.precision.weaknesses,
        *_control_warnings(facts),
        *_camera_warnings(facts),
        *_photo_warnings(facts),
        *_factor_warnings(facts),
    ]


def _control_warnings(facts: _Facts) -> list[str]:
    roles = [point.role for point in facts.control.points]
    found = []
    if not roles:
        found.append(
            "There is no ground control: absolute position and height are as good as the positions of the photographs, and "
            "nothing independent checks them."
        )
    elif "check" not in roles:
        found.append(
            "There are no check points, so nothing independent confirms the block; turn some control points into check points."
        )
    tested = {p.name: p for p in facts.ground.points}
    for point in facts.control.points:
        row = tested.get(point.name)
        if row is None or row.photos == 0:
            found.append(
                f"The {point.role} point {point.name} took no part: it has too few measurements in the oriented photographs, or "
                "all were rejected as blunders; compare its coordinates and its measurements."
            )
        elif any(abs(d) > 4.0 * s + 1e-9 for d, s in zip(row.difference, row.predicted, strict=True)):
            found.append(
                f"The {point.role} point {point.name} differs from the block by more than four times the predicted standard error; "
                "it may be wrong."
            )
    return found


def _camera_warnings(facts: _Facts) -> list[str]:
    found = [
        f"{c.first} and {c.second} can hardly be told apart (correlation {c.value:.2f}): their values are not to be used one "
        "without the "
        "other." + (" Control at different heights, or oblique photographs, would part them." if "height" in c.second else "")
        for c in facts.precision.correlations
    ]
    for name, camera in facts.block.cameras.items():
        before = facts.before.cameras[name]
        if before.source == "exif" and camera.source != "block":
            found.append(
                f"The camera {name} is known from EXIF only and was not adjusted: heights may bend over the block. Calibrate it, "
                "or let its interior orientation take part."
            )
        if camera.source == "block" and abs(camera.c / before.c - 1.0) > 0.06:
            found.append(
                f"The adjusted camera constant of {name} is {100 * (camera.c / before.c - 1):+.1f} % off the one it started with; "
                "it may have taken up other errors (a rolling shutter, wrong heights). Hold it fixed with a calibrated value to "
                "compare."
            )
    return found


def _photo_warnings(facts: _Facts) -> list[str]:
    names, found = facts.photos.names, []
    for photo in facts.block.photos:
        own = facts.image.take((facts.image.photo == names.index(photo.photo)) & facts.image.used)
        filled = _filled(own, facts.block.camera_of(photo.photo))
        if len(own) < 30 or filled < 5:
            found.append(
                f"{photo.photo} is weakly tied: {len(own)} measurements in {filled} of {CELLS * CELLS} areas of its frame."
            )
    two, _ = _coverage(facts)
    if two < 60.0:
        found.append(f"Weak overlap: only {two:.0f} % of the photographed ground is seen by two photographs or more.")
    return found


def _factor_warnings(facts: _Facts) -> list[str]:
    found, precision = [], facts.precision
    if precision.position_factor > 1.0:
        found.append(
            f"The GNSS positions are worse than stated: their standard errors were enlarged {precision.position_factor:.1f} times."
        )
    if precision.control_factor > 1.0:
        found.append(
            f"The ground control is worse than stated: its standard errors were enlarged {precision.control_factor:.1f} times."
        )
    share = precision.rejected / max(precision.rejected + precision.rays, 1)
    if share > 0.15:
        found.append(f"{100 * share:.0f} % of the image measurements were rejected; the tie points hold many wrong matches.")
    return found
