"""The page of simulated flights: how many are bent more than stated, named, blamed without reason."""

from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np

from benchmarks.flights.judged_flight import Judged
from orthomill.tasks.adjustment.testing.position_trend import SIGNIFICANT

BEYOND = 3.0
"""A flight is domed where it bends by more than so many times what its measurements would with the right camera"""
SEEN = 1.0
"""ground pixels that a dome has at least: less is below what a surface resolves"""


def page(rows: list[Judged], seconds: float) -> str:
    """The page of all flights."""
    by_noise = reference_bends(rows)
    domed = {row.seed for row in rows if is_domed(row, by_noise)}
    groups: list[tuple[str, Callable[[Judged], str]]] = [
        ("layout", lambda row: row.layout),
        ("positions", lambda row: row.receiver),
        ("ground", lambda row: row.relief),
        ("gimbal", lambda row: "attitudes of the gimbal" if row.gimbal else "no attitudes"),
        ("camera", lambda row: "sound camera" if row.sound else "c, x0, y0, k1, k3 off"),
    ]
    text = [
        "# Simulated flights: domes, stated and named",
        "",
        f"{len(rows)} flights in {seconds:.0f} s, {np.mean([row.cpu for row in rows]):.1f} CPU-seconds each.",
        "",
        "Image measurements of tie points with noise of 0.1 to 0.35 px and errors that neighbours share, no pixels; camera and "
        "standard errors as `init` takes them from tags. Truth: c within 10 % of the tag, principal point within 1 % of the width, "
        "k1 from -0.35 to 0.1, k3 from -0.3 to 0 (one flight in five is *sound*: c within 2 %, principal point within 0.1 %, k1 "
        "within 0.02). **Bend**: range of the quadratic part of the errors of ground heights after a similarity. **Bent more than "
        "stated**: the largest deviation of that part is above 2 standard errors of the height there, and above half a ground "
        f"pixel. **Domed**: the bend is above {BEYOND:.0f} times that which the measurements of such flights give with the true "
        f"camera, and above {SEEN:.0f} ground pixel. Standard error of c: share of flights within 2.",
        "",
        "| flights | number | bent more than stated (5 % wanted) | by the stated precision of the shape | domed | named, of the "
        "domed | named, of those whose positions or attitudes tell it (95 % wanted) | "
        "false alarms, of the others (1 % wanted) | median bend, ground pixels | 95 % of bends below | c within 2 "
        "standard errors | photographs lost |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        _line("**all**", rows, domed),
        *(_line(name, own, domed) for _, key in groups for name, own in _grouped(rows, key)),
        "",
        "## What is said of flights",
        "",
        "| finding | of domed flights | of the others |",
        "| --- | --- | --- |",
        *_findings(rows, domed),
        "",
        "## The worst bends",
        "",
        "| seed | flight | bend, m | of centres, m | with the true camera, m | stated in height there, m | stated bend, m | "
        "ground pixel, m | c off | k1 | k3 | x0, y0 px | said |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        *(_flight(row) for row in sorted(_known(rows), key=lambda row: -row.bend / row.ground_pixel)[:25]),
        "",
        *(["Failed:", "", *(f"- {row.seed} {_name(row)}: {row.said}" for row in rows if np.isnan(row.bend)), ""]),
    ]
    return "\n".join(text)


def reference_bends(rows: list[Judged]) -> dict[tuple[str, str], float]:
    """Root mean square bend with the true camera of the flights of a layout with a receiver, in ground pixels."""
    found: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        if np.isfinite(row.noise_bend):
            found.setdefault((row.layout, row.receiver), []).append(row.noise_bend / row.ground_pixel)
    # The median, for rarely the comparison itself fails.
    return {key: float(np.median(values)) for key, values in found.items()}


def is_domed(row: Judged, by_noise: dict[tuple[str, str], float]) -> bool:
    """Whether a flight bends by more than its measurements explain."""
    limit = max(BEYOND * by_noise.get((row.layout, row.receiver), 0.0), SEEN)
    return bool(row.bend / row.ground_pixel > limit)


def is_told(row: Judged) -> bool:
    """Whether positions or attitudes of a flight scatter so little that its bend is BEYOND standard errors above the limit of the
    tests: chance hides one in a thousand of such bends."""
    return bool(row.bend_centres > (SIGNIFICANT + BEYOND) * row.told)


def bent_more_than_stated(row: Judged) -> bool:
    """Whether the ground deviates by more than 2 of the standard errors of its height."""
    return bool(row.worst > max(2.0 * row.stated, 0.5 * row.ground_pixel))


def _known(rows: Iterable[Judged]) -> list[Judged]:
    return [row for row in rows if np.isfinite(row.bend)]


def _grouped(rows: list[Judged], key: Callable[[Judged], str]) -> list[tuple[str, list[Judged]]]:
    return [(name, [row for row in rows if key(row) == name]) for name in dict.fromkeys(map(key, rows))]


def _line(name: str, rows: list[Judged], domed: set[int]) -> str:
    known = _known(rows)
    bent, sound = [row for row in known if row.seed in domed], [row for row in known if row.seed not in domed]
    bends = [row.bend / row.ground_pixel for row in known] or [np.nan]
    shaped = [row for row in known if np.isfinite(row.shape)]
    cells = (
        name,
        str(len(rows)),
        _share([bent_more_than_stated(row) for row in known]),
        _share([row.bend > max(2.0 * row.shape, 0.5 * row.ground_pixel) for row in shaped]),
        str(len(bent)),
        _share([bool(row.named) for row in bent]),
        _share([bool(row.named) for row in bent if is_told(row)]),
        _share([bool(row.named) for row in sound]),
        f"{np.median(bends):.2f}",
        f"{np.percentile(bends, 95):.1f}",
        _share([abs(row.c_error) <= 2.0 * row.c_stated for row in known]),
        f"{sum(row.lost for row in rows)} of {sum(row.photos for row in rows)}",
    )
    return f"| {' | '.join(cells)} |"


def _share(found: list[bool]) -> str:
    return f"{100 * np.mean(found):.1f} %" if found else "-"


def _findings(rows: list[Judged], domed: set[int]) -> list[str]:
    known = _known(rows)
    parts = [[row for row in known if (row.seed in domed) is bent] for bent in (True, False)]
    counts = [Counter(name for row in part for name in set(row.said.split())) for part in parts]
    names = sorted(set(counts[0]) | set(counts[1]))
    return [f"| {name} | {counts[0][name]} of {len(parts[0])} | {counts[1][name]} of {len(parts[1])} |" for name in names]


def _name(row: Judged) -> str:
    gimbal, camera = "gimbal" if row.gimbal else "no attitudes", ", sound" if row.sound else ""
    return f"{row.layout}, {row.relief}, {row.receiver}, {gimbal}{camera}"


def _flight(row: Judged) -> str:
    lengths = f"{row.bend:.2f} | {row.bend_centres:.2f} | {row.noise_bend:.3f}"
    lengths += f" | {row.stated:.3f} | {row.shape:.3f} | {row.ground_pixel:.3f}"
    camera = f"{100 * row.wrong_c:+.1f} % | {row.k1:+.2f} | {row.k3:+.2f} | {row.x0:+.0f}, {row.y0:+.0f}"
    return f"| {row.seed} | {_name(row)} | {lengths} | {camera} | {row.said or 'nothing'} |"
