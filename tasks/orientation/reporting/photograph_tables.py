"""The photographs of a block as tables: image residuals, exterior orientation, pairs, and those that did not join."""

import numpy as np

from orthomill.schemas.orientation import ExteriorOrientation, RelativeOrientation
from orthomill.schemas.stage_report import Grid
from orthomill.tasks.orientation.reporting.block_facts import CELLS, Facts, filled_areas
from orthomill.tasks.orientation.reporting.block_figures import exterior_sigmas

Row = tuple[float | int | str | None, ...]
COUNTS = ("photo", "measurements", "rejected")
SIZES = ("rms col px", "rms row px", "rms micrometres", "largest px", f"areas with points, of {CELLS * CELLS}")
CENTRE = ("X", "Y", "Z", "sigma X", "sigma Y", "sigma Z")
ANGLES = ("omega", "phi", "kappa")


def photograph_grids(facts: Facts) -> tuple[Grid, ...]:
    """The tables; those without a row are left out by the report."""
    return _image_residuals(facts), _exterior(facts), _pairs(facts), _unoriented(facts)


def _image_residuals(facts: Facts) -> Grid:
    rows = tuple(_residual_row(facts, photo) for photo in facts.block.photos)
    return Grid(title="Image residuals", columns=(*COUNTS, *SIZES), rows=rows)


def _residual_row(facts: Facts, photo: ExteriorOrientation) -> Row:
    seen = facts.image.photo == facts.photos.names.index(photo.photo)
    own, camera = facts.image.take(seen & facts.image.used), facts.block.camera_of(photo.photo)
    # float32 squares of many residuals would lose digits in their sum.
    rms = [float(np.sqrt((v.astype(float) ** 2).mean())) if len(v) else None for v in (own.v_col, own.v_row)]
    size = np.hypot(own.v_col, own.v_row)
    # Micrometres are what analogue specifications and older reports state.
    um = photo.residual_px * camera.pixel_um if camera.pixel_um and photo.residual_px else None
    largest = float(size.max()) if len(size) else None
    return photo.photo, len(own), int(seen.sum()) - len(own), *rms, um, largest, filled_areas(own, camera)


def _exterior(facts: Facts) -> Grid:
    rows: list[Row] = []
    for photo in facts.block.photos:
        sigma = [float(v) if np.isfinite(v) else None for v in exterior_sigmas(photo)]
        rows.append((photo.photo, *photo.centre, *sigma[:3], *photo.omega_phi_kappa, *sigma[3:]))
    return Grid(
        title="Exterior orientation",
        columns=("photo", *CENTRE, *ANGLES, *(f"sigma {angle}" for angle in ANGLES)),
        rows=tuple(rows),
        note="Metres and degrees.",
    )


def _pairs(facts: Facts) -> Grid:
    about = tuple(f"sigma about {axis}" for axis in "xyz")
    return Grid(
        title="Relative orientation of pairs",
        columns=("left", "right", "matches", "kept", "sigma0 px", "by", "bz", *ANGLES, *about, "intersection", "outcome"),
        rows=tuple(_pair_row(pair) for pair in facts.relative.pairs),
        note="Angles in degrees; b_y and b_z for b_x = 1, where the base lies along x.",
    )


def _pair_row(pair: RelativeOrientation) -> Row:
    base = pair.by_bz or (None, None)
    # The first two standard errors are those of the base; the table shows them of the rotation only.
    sigma = pair.sigma[2:] if pair.sigma else (None,) * 3
    counts = pair.left, pair.right, pair.matches, pair.kept, pair.sigma0_px
    return *counts, *base, *pair.omega_phi_kappa, *sigma, pair.intersection_deg, pair.outcome


def _unoriented(facts: Facts) -> Grid:
    return Grid(
        title="Photographs that did not join the block",
        columns=("photo", "reason"),
        rows=tuple((u.photo, u.reason) for u in facts.block.unoriented),
    )
