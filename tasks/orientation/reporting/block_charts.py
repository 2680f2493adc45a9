"""The charts of a block: residuals, and the places of photographs and points."""

import numpy as np
from scipy.sparse import csr_array

from orthomill.schemas.camera import Camera
from orthomill.schemas.observations import ImageResiduals
from orthomill.schemas.stage_report import Chart
from orthomill.tasks.orientation.reporting.block_facts import Facts

PHOTOS_SHOWN, ARROWS_SHOWN, EDGES_SHOWN = 4, 150, 400
"""What remains legible in a chart of the report's size."""
BINS = 12
"""Areas along each side of a frame for mean residuals"""
STRENGTHS = (("300 tie points or more", 300, np.inf), ("100 to 299", 100, 300), ("30 to 99", 30, 100), ("fewer than 30", 1, 30))
"""Classes of connection between two photographs, by the tie points that they share"""


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
    used = facts.image.used
    # Residuals beyond four sigma0 are rejected by default, so the rest fits into these limits.
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
        caption="Of the measurements that took part; a normal distribution about zero is expected.",
    )


def _arrows(facts: Facts, name: str) -> Chart | None:
    """Mean residual in a grid of areas over the frame: what the camera model leaves unexplained."""
    camera = facts.block.cameras[name]
    numbers = [facts.photos.names.index(photo) for photo, own in facts.block.of_photo.items() if own == name]
    own = facts.image.take(facts.image.used & np.isin(facts.image.photo, numbers))
    if not len(own):
        return None
    x, y, dx, dy = _mean_residuals(own, camera)
    return Chart(
        title=f"Mean image residuals over the frame, camera {name}",
        style="arrows",
        x_label="x, px",
        y_label="y, px",
        x=_floats(x),
        series={"y": _floats(y), "dx": _floats(dx), "dy": _floats(-dy)},
        caption=f"The frame as one looks at the photograph, from its middle, y up; arrows are exaggerated, the longest is "
        f"{np.hypot(dx, dy).max() if len(dx) else 0:.2f} px. A pattern means that the camera model does not fit the lens.",
    )


def _mean_residuals(own: ImageResiduals, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The middles x, y (px from the middle of the frame, y up) and mean residuals (px, as in the tables) of the areas with enough
    residuals."""
    col, row = ((v / size * BINS).astype(int).clip(0, BINS - 1) for v, size in ((own.col, camera.width), (own.row, camera.height)))
    cell = row * BINS + col
    count = np.bincount(cell, minlength=BINS * BINS)
    # The mean of one or two residuals would show their noise, not the camera.
    keep = np.flatnonzero(count >= 3)
    dx, dy = (np.bincount(cell, v, minlength=BINS * BINS)[keep] / count[keep] for v in (own.v_col, own.v_row))
    x = ((keep % BINS + 0.5) / BINS - 0.5) * camera.width
    y = (0.5 - (keep // BINS + 0.5) / BINS) * camera.height
    return x, y, dx, dy


def _floats(values: np.ndarray) -> tuple[float, ...]:
    return tuple(map(float, values))


def _rms_per_photo(facts: Facts) -> Chart:
    known = _known_residuals(facts)
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
    known = _known_residuals(facts)
    return sorted(known, key=lambda name: -known[name])[:PHOTOS_SHOWN]


def _known_residuals(facts: Facts) -> dict[str, float]:
    """Photograph -> root mean square residual, px."""
    return {photo.photo: photo.residual_px for photo in facts.block.photos if photo.residual_px is not None}


def _photo_arrows(facts: Facts, name: str) -> Chart | None:
    """The single residuals of one photograph, thinned to a legible number."""
    own = facts.image.take(facts.image.used & (facts.image.photo == facts.photos.names.index(name)))
    if not len(own):
        return None
    # Evenly through the table, which is sorted by track: a random choice would change with every report.
    own = own.take(np.unique(np.linspace(0, len(own) - 1, ARROWS_SHOWN).astype(int)))
    camera = facts.block.camera_of(name)
    x, y = own.col - (camera.width - 1) / 2, (camera.height - 1) / 2 - own.row
    return Chart(
        title=f"Image residuals of {name}",
        style="arrows",
        x_label="x, px",
        y_label="y, px",
        x=tuple(map(float, x)),
        series={"y": tuple(map(float, y)), "dx": tuple(map(float, own.v_col)), "dy": tuple(map(float, -own.v_row))},
        caption=f"One of the {PHOTOS_SHOWN} photographs with the largest residuals; up to {ARROWS_SHOWN} of its measurements, "
        "arrows exaggerated. Neighbours that point the same way mean a systematic error.",
    )


def _graph(facts: Facts) -> Chart | None:
    """Which photographs share tie points, and how many: a line for every pair between the projection centres."""
    names = facts.photos.names
    place = {names.index(photo.photo): photo.centre[:2] for photo in facts.block.photos}
    # Surveyed points have negative numbers; they connect no photographs by matches.
    used = facts.image.take(facts.image.used & (facts.image.track >= 0))
    if not len(used):
        return None
    shared = _shared(used, len(names))
    pairs = [(i, j) for i in place for j in place if i < j and shared[i, j] > 0]
    pairs = sorted(pairs, key=lambda pair: -shared[pair])[:EDGES_SHOWN]
    series = {label: _lines(pairs, place, shared, least, most) for label, least, most in STRENGTHS}
    return Chart(
        title="Photographs that share tie points",
        style="lines",
        x_label="X, m",
        y_label="Y, m",
        x=tuple(float(x) for i, j in pairs for x in (place[i][0], place[j][0], np.nan)),
        series={label: values for label, values in series.items() if np.isfinite(values).any()},
        caption="A line joins the projection centres of two photographs, coloured by how many tie points they share"
        + (f"; the {EDGES_SHOWN} strongest of them." if len(pairs) == EDGES_SHOWN else ".")
        + " Where only a few weak lines connect two parts of a block, it can bend there.",
    )


def _shared(used: ImageResiduals, photos: int) -> np.ndarray:
    """(P, P) tie points that two photographs share."""
    seen = csr_array((np.ones(len(used), np.int32), (used.photo, used.track)), shape=(photos, int(used.track.max()) + 1))
    shared: np.ndarray = (seen @ seen.T).toarray()
    return shared


def _lines(
    pairs: list[tuple[int, int]], place: dict[int, tuple[float, float]], shared: np.ndarray, least: int, most: float
) -> tuple[float, ...]:
    """Y of the lines between photographs with `least` to below `most` common tie points. NaN interrupts a line: all classes are
    drawn over the same X."""
    nothing = (np.nan,) * 3
    ends = ((place[i][1], place[j][1], np.nan) if least <= shared[i, j] < most else nothing for i, j in pairs)
    return tuple(float(y) for end in ends for y in end)


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
