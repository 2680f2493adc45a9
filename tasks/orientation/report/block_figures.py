"""The figures that a surveyor signs: photographs, precision, observations, coverage, and differences to what was surveyed."""

from collections.abc import Iterator

from orthomill.schemas.orientation import Block, GroundResidual
from orthomill.schemas.stage_report import Figure
from orthomill.tasks.orientation.examined.block_facts import Facts
from orthomill.tasks.orientation.examined.block_numbers import accuracy, centre_sigmas, ground_sigmas
from orthomill.tasks.orientation.examined.photographed_surface import coverage
from orthomill.tasks.orientation.report.source_tables import source_figures

PLACES = {
    "control": "at the control points, which hold the block",
    "check": "at the check points, which took no part in the adjustment",
    "gnss": "at the projection centres, whose positions were observed",
}
"""Words in the names of figures, and where their differences are found."""
LABELS = {"control": "control points", "check": "check points", "gnss": "projection centres"}
ROLES = {"control": "control", "check": "check", "gnss": "position"}


def block_figures(facts: Facts) -> tuple[Figure, ...]:
    """All figures, in the order in which they are read."""
    return (
        *_photographs(facts),
        *_sigma0(facts),
        *_observations(facts),
        *_precision(facts),
        *source_figures(facts.precision),
        *_coverage(facts),
        *(figure for word, role in ROLES.items() for figure in _ground(_counted(facts, role), word)),
    )


def _counted(facts: Facts, role: str) -> tuple[GroundResidual, ...]:
    """The points of a role without those that the adjustment set aside: a blunder that took no part says nothing of the fit."""
    blunders = () if role == "check" else facts.precision.blunders
    return tuple(point for point in facts.ground.of_role(role) if point.name not in blunders)


def _photographs(facts: Facts) -> Iterator[Figure]:
    block = facts.block
    yield Figure(
        name="photos_oriented", value=len(block.photos), sentence=f"of {len(facts.photos.photos)} photographs", headline=True
    )
    yield Figure(name="photos_unoriented", value=len(block.unoriented), sentence="Photographs that did not join the block.")
    yield Figure(name="datum", value=block.datum)
    yield Figure(
        name="height_reference",
        value=facts.heights or "not stated",
        sentence="What heights count from. Not stated: from where the heights of control or positions count; state it as the part "
        "of crs after a plus sign.",
    )


def _sigma0(facts: Facts) -> Iterator[Figure]:
    # A fixed block without tie points has a nominal sigma0 in its table, because weights need one; nothing estimated it.
    sigma0 = facts.block.sigma0_px if len(facts.image) else None
    pixel = _pixel_um(facts.block)
    precision = facts.precision
    yield Figure(
        name="sigma0_px",
        label="Precision of an image measurement",
        value=sigma0,
        unit="px",
        headline=True,
        sentence="Standard error of an image coordinate, estimated from the residuals and their redundancy; empty for a block of "
        "another program that no tie points examine.",
    )
    yield Figure(
        name="sigma0_um",
        label="Precision on the sensor",
        value=sigma0 * pixel if sigma0 and pixel else None,
        unit="micrometres",
        sentence="The same on the sensor or scan; empty when the pixel size is unknown.",
    )
    yield Figure(
        name="sigma0_factor",
        label="Measured by stated precision",
        value=precision.image_factor,
        sentence="Estimated by stated standard error of the image measurements.",
    )
    yield Figure(
        name="common_errors_px",
        value=precision.common_px,
        unit="px",
        sentence="Displacements that whole regions of a photograph share (stabiliser, shutter, lens), from the residuals; all "
        "standard errors include them. Empty where the residuals are white noise.",
    )
    yield Figure(
        name="common_errors_of_camera",
        value=None if precision.common_share is None else 100.0 * precision.common_share,
        unit="%",
        sentence="Of their variance, the part that is the same in all photographs of a camera.",
    )


def _pixel_um(block: Block) -> float | None:
    """The pixel size that all cameras share; None where they differ, or one of them does not state it."""
    # Micrometres of different sensors do not add up to one figure.
    sizes = {camera.pixel_um for camera in block.cameras.values()}
    return sizes.pop() if len(sizes) == 1 else None


def _observations(facts: Facts) -> Iterator[Figure]:
    block, precision, points = facts.block, facts.precision, facts.points
    yield Figure(name="redundancy", value=block.redundancy, sentence="Observations in excess of the unknowns.")
    yield Figure(name="iterations", value=block.iterations, sentence="Of all adjustments, including those of the blunder tests.")
    yield Figure(name="tie_points", value=len(points), sentence="Tie points on the ground, each seen by two photographs or more.")
    yield Figure(
        name="rays_per_point",
        value=float(points.rays.mean()) if len(points) else None,
        sentence="Photographs per tie point, on average.",
    )
    yield Figure(name="image_measurements", value=precision.rays, sentence="Points measured in photographs that took part.")
    yield Figure(
        name="image_measurements_rejected",
        value=precision.rejected,
        sentence="Measurements that contradicted the others and took no part.",
    )


def _precision(facts: Facts) -> Iterator[Figure]:
    centres, ground = centre_sigmas(facts.block), ground_sigmas(facts.points)
    yield Figure(
        name="centre_sigma_plan", value=centres.plan, unit="m", sentence="Median standard error of the projection centres in plan."
    )
    yield Figure(name="centre_sigma_height", value=centres.height, unit="m")
    yield Figure(
        name="ground_sigma_plan",
        value=ground.plan,
        unit="m",
        sentence="Median standard error of the tie points in plan, including the effect of the orientation.",
    )
    yield Figure(name="ground_sigma_height", value=ground.height, unit="m")
    yield Figure(
        name="ground_bend_sigma",
        label="Precision of the shape",
        value=facts.precision.bend_sigma,
        unit="m",
        sentence="Standard error of the height difference that a bend of the whole ground (a dome, a bowl, a twist) adds over the "
        "block; place and tilt have no part in it. Empty without tie points.",
    )
    yield Figure(
        name="ground_bend_extent",
        value=facts.precision.bend_extent,
        unit="m",
        sentence="Length of the block over which it may bend.",
    )


def _coverage(facts: Facts) -> Iterator[Figure]:
    # Without tie points the surface is not known, on which overlap is counted.
    by_two, by_three = coverage(facts) if len(facts.points) else (None, None)
    yield Figure(
        name="covered_by_two",
        value=by_two,
        unit="%",
        sentence="Share of the photographed surface that two photographs or more see.",
    )
    yield Figure(name="covered_by_three", value=by_three, unit="%")


def _ground(points: tuple[GroundResidual, ...], word: str) -> Iterator[Figure]:
    found = accuracy(points)
    if found is None:
        return
    # Only check points are independent of the adjustment: their differences are its accuracy, the others its fit.
    headline = word == "check"
    yield Figure(name=f"{word}_count", label=f"Number of {LABELS[word]}", value=found.points)
    yield Figure(
        name=f"{word}_rmse_plan",
        label=f"Accuracy in plan at {LABELS[word]}" if headline else f"Differences in plan at {LABELS[word]}",
        value=found.plan,
        unit="m",
        headline=headline,
        sentence=f"Root mean square difference in plan, {PLACES[word]}.",
    )
    yield Figure(
        name=f"{word}_rmse_height",
        label=f"Accuracy in height at {LABELS[word]}" if headline else f"Differences in height at {LABELS[word]}",
        value=found.height,
        unit="m",
        headline=headline,
        sentence=f"The same in height, {PLACES[word]}.",
    )
    yield Figure(
        name=f"{word}_by_predicted",
        value=found.by_predicted,
        sentence="Differences in units of their predicted standard errors, root mean square: about 1 when the stated precision is "
        "realistic; well below, it could be stated better.",
    )
