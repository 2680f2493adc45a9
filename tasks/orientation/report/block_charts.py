"""The charts of a block: residuals, and the places of photographs and points."""

from orthomill.schemas.stage_report import Chart
from orthomill.tasks.orientation.examined.block_facts import Facts
from orthomill.tasks.orientation.examined.residual_places import (
    ARROWS_SHOWN,
    EDGES_SHOWN,
    PHOTOS_SHOWN,
    known_residuals,
    longest,
    mean_arrows,
    photo_arrows,
    residual_classes,
    tie_lines,
)


def block_charts(facts: Facts) -> list[Chart]:
    """Residuals and their place in the frame, centres and ground points, and check points."""
    charts = [
        _histogram(facts),
        _rms_per_photo(facts),
        *(_arrows(facts, name) for name in facts.shown_cameras),
        *(_photo_arrows(facts, name) for name in _worst(facts)),
        _map(facts),
        _graph(facts),
    ]
    if facts.ground.of_role("check"):
        charts.append(_check_chart(facts))
    return [chart for chart in charts if chart]


def _histogram(facts: Facts) -> Chart:
    middles, counts = residual_classes(facts)
    return Chart(
        title="Image residuals",
        style="bars",
        x_label="residual, px",
        y_label="measurements",
        x=middles,
        series=counts,
        caption="Of the measurements that took part; a normal distribution about zero is expected.",
    )


def _arrows(facts: Facts, name: str) -> Chart | None:
    """Mean residual in a grid of areas over the frame: what the camera model leaves unexplained."""
    arrows = mean_arrows(facts, name)
    if arrows is None:
        return None
    return Chart(
        title=f"Mean image residuals over the frame, camera {name}",
        style="arrows",
        x_label="x, px",
        y_label="y, px",
        x=arrows.x,
        series={"y": arrows.y, "dx": arrows.dx, "dy": arrows.dy},
        caption=f"The frame as one looks at the photograph, from its middle, y up; arrows are exaggerated, the longest is "
        f"{longest(arrows):.2f} px. A pattern means that the camera model does not fit the lens.",
    )


def _rms_per_photo(facts: Facts) -> Chart:
    known = known_residuals(facts)
    return Chart(
        title="Image residuals by photograph",
        style="bars",
        x_label="photograph",
        y_label="root mean square, px",
        x=tuple(float(i) for i in range(1, len(known) + 1)),
        series={"rms": tuple(known.values())},
        labels=tuple(known),
    )


def _worst(facts: Facts) -> list[str]:
    """The photographs with the largest residuals, by name."""
    known = known_residuals(facts)
    return sorted(known, key=lambda name: -known[name])[:PHOTOS_SHOWN]


def _photo_arrows(facts: Facts, name: str) -> Chart | None:
    arrows = photo_arrows(facts, name)
    if arrows is None:
        return None
    return Chart(
        title=f"Image residuals of {name}",
        style="arrows",
        x_label="x, px",
        y_label="y, px",
        x=arrows.x,
        series={"y": arrows.y, "dx": arrows.dx, "dy": arrows.dy},
        caption=f"One of the {PHOTOS_SHOWN} photographs with the largest residuals; up to {ARROWS_SHOWN} of its measurements, "
        "arrows exaggerated. Neighbours that point the same way mean a systematic error.",
    )


def _graph(facts: Facts) -> Chart | None:
    """Which photographs share tie points, and how many: a line for every pair between the projection centres."""
    ties = tie_lines(facts)
    if ties is None:
        return None
    return Chart(
        title="Photographs that share tie points",
        style="lines",
        x_label="X, m",
        y_label="Y, m",
        x=ties.x,
        series=ties.y,
        caption="A line joins the projection centres of two photographs, coloured by how many tie points they share"
        + (f"; the {EDGES_SHOWN} strongest of them." if ties.lines == EDGES_SHOWN else ".")
        + " Where only a few weak lines connect two parts of a block, it can bend there.",
    )


def _map(facts: Facts) -> Chart:
    centres = [(photo.photo, *photo.centre[:2]) for photo in facts.block.photos]
    # Tie points measured by a person have no coordinates to draw.
    named = centres + [(point.name, *point.xyz[:2]) for point in facts.control.points if point.role != "tie"]
    return Chart(
        title="Projection centres and ground points",
        style="map",
        x_label="X, m",
        y_label="Y, m",
        x=tuple(float(x) for _, x, _ in named),
        series={"y": tuple(float(y) for _, _, y in named)},
        labels=tuple(name for name, _, _ in named),
    )


def _check_chart(facts: Facts) -> Chart:
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
