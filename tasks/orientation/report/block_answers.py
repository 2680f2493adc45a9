"""What the block is worth to a client: accuracy where check points tell it, precision, photographs used, and a verdict.

The limits for differences at check points are multiples of the ground pixel, as in the ASPRS Positional Accuracy Standards for
Digital Geospatial Data (2014, annex B; edition 2, 2023): 1 for the most accurate work, 2 for standard mapping, 3 for visualisation.
"""

from collections.abc import Iterator
from math import isnan

from orthomill.schemas.findings.datum_findings import NoDatum, PositionsCrowded
from orthomill.schemas.orientation import GroundResidual
from orthomill.schemas.stage_report import Answer, Evidence, Product, Topic, Verdict
from orthomill.tasks.geometry.reference_system import on_earth
from orthomill.tasks.orientation.examined.block_facts import Facts
from orthomill.tasks.orientation.examined.block_numbers import (
    Accuracy,
    accuracy,
    contradicts_precision,
    ground_pixel,
    point_sigmas,
    wrong_alone,
)

CLASSES = ((1.0, "the most accurate mapping (1 pixel)"), (2.0, "standard mapping (2 pixels)"), (3.0, "visualisation (3 pixels)"))
"""Limit in ground pixels, and what differences below it are good enough for."""
FORMAL = 30
"""check points that a formal statement of accuracy needs (ASPRS, edition 2)"""
UNCHECKED = "not checked: no check points"
REALISTIC = 3.0
"""Differences this many times their predicted standard errors put the block in doubt, whatever chance says of so few."""

PRODUCTS = (
    Product(path="products/exterior_orientation.csv", purpose="Position and rotation of every photograph, as a table"),
    Product(path="products/cameras.json", purpose="The whole block with its cameras and covariances"),
    Product(path="products/colmap", purpose="The block for COLMAP and what reads its files"),
    Product(path="products/opensfm", purpose="The block for OpenSfM and OpenDroneMap"),
)


def block_answers(facts: Facts) -> Iterator[Answer]:
    """What the orientation answers to a client's questions."""
    used, given = len(facts.block.photos), len(facts.photos.photos)
    yield Answer(topic=Topic.PHOTOGRAPHS, text=f"all {given}" if used == given else f"{used} of {given}")
    pixel, found = ground_pixel(facts), accuracy(facts.ground.of_role("check"))
    if pixel:
        yield Answer(topic=Topic.GROUND_PIXEL, text=f"{_length(pixel, facts)} in the photographs")
    yield Answer(topic=Topic.ACCURACY_PLAN, text=_checked(found.plan, found.points) if found else UNCHECKED)
    yield Answer(topic=Topic.ACCURACY_HEIGHT, text=_checked(found.height, found.points) if found else UNCHECKED)
    if sigmas := point_sigmas(facts):
        plan, height = (_length(sigma, facts) for sigma in sigmas)
        yield Answer(topic=Topic.PRECISION, text=f"{plan} in plan, {height} in height (standard error of a point)")
    yield Answer(topic=Topic.REFERENCE, text=_heights(facts))


def _heights(facts: Facts) -> str:
    """What heights refer to; a block without a place on earth is not even in the project's system."""
    if not on_earth(facts.block.crs):
        return "not reached: the block is in a local system without place"
    return f"heights: {facts.heights or 'as in the input, system not stated'}"


def block_evidence(facts: Facts) -> Iterator[Evidence]:
    """What check points say of the orientations. Rays of the block say nothing of a surface or an orthoimage made from it: they are
    tested at the points themselves, by the stage `accuracy`."""
    if found := accuracy(facts.ground.of_role("check")):
        formal = "" if found.points >= FORMAL else f"; a formal statement needs {FORMAL}"
        source = f"from {_points(found.points)}{formal}"
        orientations = tuple(product.path for product in PRODUCTS)
        yield Evidence(of="plan", rmse=found.plan, source=source, products=orientations)
        yield Evidence(of="height", rmse=found.height, source=source, products=orientations)


def _checked(value: float, points: int) -> str:
    return f"{length(value)} (root mean square of {_points(points)})"


def _points(count: int) -> str:
    return "1 check point" if count == 1 else f"{count} check points"


def block_lengths(facts: Facts) -> str:
    """What lengths of the block are worth; empty where they are metres."""
    return "the block has no scale: not in metres" if _is_unscaled(facts) else ""


def _is_unscaled(facts: Facts) -> bool:
    return any(isinstance(finding, NoDatum) and not finding.scaled for finding in facts.precision.findings)


def block_verdict(facts: Facts, doubts: tuple[str, ...]) -> Verdict:
    """Good where check points say so, fair where nothing independent does, poor where a doubt or the check points contradict it."""
    found, pixel = accuracy(facts.ground.of_role("check")), ground_pixel(facts)
    if found is None and _is_unscaled(facts):
        crowded = any(isinstance(finding, PositionsCrowded) for finding in facts.precision.findings)
        without = (
            "the positions lie closer together than their standard errors, and there are neither control nor check points"
            if crowded
            else "the block has neither positions nor control nor check points"
        )
        return Verdict(level="poor", sentence=f"Accuracy is not proved, and there is no scale: {without}.", weighs=True)
    if found is None:
        stated = f" (stated: {length(sigmas[1])} in height)" if (sigmas := point_sigmas(facts)) else ""
        words = f"Accuracy is not proved: there are no check points, only the precision that the adjustment states{stated}."
        return Verdict(level="poor" if doubts else "fair", sentence=words, weighs=True)
    largest = max(found.plan, found.height) / pixel if pixel else float("nan")
    good_for = next((words for limit, words in CLASSES if largest <= limit), None)
    grave, rare = found.by_predicted > REALISTIC, contradicts_precision(found, facts.ground.checked)
    good = largest <= CLASSES[1][0] and not rare
    level = "poor" if doubts or grave or (pixel and good_for is None) else "good" if good else "fair"
    alone = wrong_alone(facts.ground.of_role("check"), facts.ground.checked)
    return Verdict(level=level, sentence=_accuracy_sentence(found, largest, good_for, grave or rare, alone), weighs=True)


def _accuracy_sentence(
    found: Accuracy, largest: float, good_for: str | None, contradicted: bool, alone: tuple[GroundResidual, Accuracy] | None
) -> str:
    formal = "" if found.points >= FORMAL else f"; a formal statement needs {FORMAL}"
    reached = f"it meets the class for {good_for}" if good_for else "it meets no mapping class (3 pixels)"
    expected = f", {found.by_predicted:.1f} times what the adjustment predicts" if contradicted else ""
    # Without tie points nobody knows how large a pixel is on the ground, and no class follows.
    classed = "" if isnan(largest) else f"; with {largest:.1f} ground pixels {reached}"
    others = (
        f"; without {alone[0].name}, which is wrong by itself: {length(alone[1].plan)} and {length(alone[1].height)}, "
        f"{alone[1].by_predicted:.1f} times"
        if alone
        else ""
    )
    return (
        f"The block at {_points(found.points)}: {length(found.plan)} in plan and {length(found.height)} in height{expected}"
        f"{others}{classed}{formal}."
    )


def _length(metres: float, facts: Facts) -> str:
    # A thousandth of a unit that is no metre has no name; what is called m here is told in units of the block.
    return f"{metres:.3g} m" if _is_unscaled(facts) else length(metres)


def length(metres: float) -> str:
    """A length with the digits that it deserves: 2.3 m, 0.28 m, 12 mm."""
    if metres < 0.1:
        return f"{1000 * metres:.0f} mm" if metres >= 0.0095 else f"{1000 * metres:.1f} mm"
    return f"{metres:.2f} m" if metres < 10 else f"{metres:.0f} m"
