"""The charts of a block: what residuals look like, and where everything lies."""

import numpy as np

from schemas.report import Chart
from tasks.orientation.report_facts import Facts


def block_charts(facts: Facts) -> list[Chart]:
    """Residuals and their place in the frame, centres and ground points, and check points."""
    charts = [_histogram(facts), *(_arrows(facts, name) for name in facts.block.cameras), _map(facts)]
    if facts.ground.of_role("check"):
        charts.append(_check_chart(facts))
    return [chart for chart in charts if chart]


def _histogram(facts: Facts) -> Chart:
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


def _arrows(facts: Facts, name: str) -> Chart | None:
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


def _map(facts: Facts) -> Chart:
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
