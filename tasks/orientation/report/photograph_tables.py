"""The photographs of a block as tables: image residuals, exterior orientation, pairs, and those that did not join."""

from orthomill.schemas.orientation import ExteriorOrientation, RelativeOrientation
from orthomill.schemas.stage_report import Grid
from orthomill.tasks.orientation.examined.block_facts import CELLS, Facts
from orthomill.tasks.orientation.examined.block_numbers import known_sigmas, photo_residual_numbers

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
    numbers, camera = photo_residual_numbers(facts, photo.photo), facts.block.camera_of(photo.photo)
    # Micrometres are what analogue specifications and older reports state.
    um = photo.residual_px * camera.pixel_um if camera.pixel_um and photo.residual_px else None
    rms = numbers.rms_col, numbers.rms_row
    return photo.photo, numbers.used, numbers.rejected, *rms, um, numbers.largest, numbers.areas


def _exterior(facts: Facts) -> Grid:
    rows: list[Row] = []
    for photo in facts.block.photos:
        sigma = known_sigmas(photo)
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
