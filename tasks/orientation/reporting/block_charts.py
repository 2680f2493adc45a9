"""The charts of a block: what residuals look like, and where everything lies."""

import numpy as np
from scipy.sparse import csr_array

from orthomill.schemas.stage_report import Chart
from orthomill.tasks.orientation.reporting.block_facts import Facts

PHOTOS_SHOWN, ARROWS_SHOWN, EDGES_SHOWN = 4, 150, 400
STRENGTHS = (("300 tie points or more", 300), ("100 to 299", 100), ("30 to 99", 30), ("fewer than 30", 1))
"""How strongly two photographs hang together, by the tie points that they share"""


def block_charts(facts: Facts) -> list[Chart]:
    """Residuals and their place in the frame, centres and ground points, and check points."""
    charts = [
        _histogram(facts),
        _rms_per_photo(facts),
        *(_arrows(facts, name) for name in facts.block.cameras),
        *(_photo_arrows(facts, name) for name in _worst(facts)),
        _map(facts),
        _graph(facts),
    ]
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
        x_label="x, px",
        y_label="y, px",
        x=tuple(float(v) for v in ((keep % bins + 0.5) / bins - 0.5) * camera.width),
        series={
            "y": tuple(float(v) for v in (0.5 - (keep // bins + 0.5) / bins) * camera.height),
            "dx": tuple(map(float, dx)),
            "dy": tuple(map(float, -dy)),
        },
        caption=f"The frame as one looks at the photograph, from its middle, y up; arrows are exaggerated, the longest is "
        f"{np.hypot(dx, dy).max() if len(dx) else 0:.2f} px. A pattern means that the camera model does not fit the lens.",
    )


def _rms_per_photo(facts: Facts) -> Chart:
    photos = [photo for photo in facts.block.photos if photo.residual_px is not None]
    return Chart(
        title="Image residuals by photograph",
        style="bars",
        x_label="photograph",
        y_label="root mean square, px",
        x=tuple(float(i) for i in range(1, len(photos) + 1)),
        series={"rms": tuple(photo.residual_px for photo in photos)},
        labels=tuple(photo.photo for photo in photos),
    )


def _worst(facts: Facts) -> list[str]:
    """The photographs with the largest residuals, by name."""
    known = [photo for photo in facts.block.photos if photo.residual_px is not None]
    return [photo.photo for photo in sorted(known, key=lambda photo: -photo.residual_px)[:PHOTOS_SHOWN]]


def _photo_arrows(facts: Facts, name: str) -> Chart | None:
    """The single residuals of one photograph, thinned to what can be read."""
    own = facts.image.take(facts.image.used & (facts.image.photo == facts.photos.names.index(name)))
    if not len(own):
        return None
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
    used = facts.image.take(facts.image.used & (facts.image.track >= 0))
    if not len(used):
        return None
    shows = csr_array((np.ones(len(used), np.int32), (used.photo, used.track)), shape=(len(names), int(used.track.max()) + 1))
    shared = (shows @ shows.T).toarray()
    pairs = [(i, j) for i in place for j in place if i < j and shared[i, j] > 0]
    pairs = sorted(pairs, key=lambda pair: -shared[pair])[:EDGES_SHOWN]
    x, series = [], {label: [] for label, _ in STRENGTHS}
    for i, j in pairs:
        x += [place[i][0], place[j][0], np.nan]
        strength = next(label for label, least in STRENGTHS if shared[i, j] >= least)
        for label, values in series.items():
            values += [place[i][1], place[j][1], np.nan] if label == strength else [np.nan] * 3
    return Chart(
        title="Photographs that share tie points",
        style="lines",
        x_label="X, m",
        y_label="Y, m",
        x=tuple(map(float, x)),
        series={label: tuple(map(float, values)) for label, values in series.items() if np.isfinite(values).any()},
        caption="A line joins the projection centres of two photographs, coloured by how many tie points they share"
        + (f"; the {EDGES_SHOWN} strongest of them." if len(pairs) == EDGES_SHOWN else ".")
        + " Where a block hangs together by a few weak lines only, it can bend or break.",
    )


def _map(facts: Facts) -> Chart:
    centres = [(photo.photo, *photo.centre[:2]) for photo in facts.block.photos]
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
