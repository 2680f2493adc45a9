"""Figures of a task where OpenDroneMap writes them (odm_report/stats.json): those that a run knows, by the names and in the units
that WebODM shows. What is not known is left out.

Sources: OpenDroneMap, stages/odm_report.py; OpenSfM, opensfm/stats.py; WebODM, app/models/task.py (get_statistics).
"""

import json
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

_MOMENT = "%d/%m/%Y at %H:%M:%S"


def client_figures(summary: Path, shots: Path | None, control: Path | None, cloud: Path | None) -> dict[str, Any]:
    """The figures, of the summary of a run, its shots.geojson and ground_control_points.geojson, and its cloud of points."""
    value = {name: figure["value"] for name, figure in json.loads(summary.read_text()).items()}
    figures = {
        "processing_statistics": {"area": _area(value), **_days(shots)},
        "reconstruction_statistics": {
            "has_gps": bool(value.get("orientation.gnss_count")),
            "has_gcp": bool(value.get("orientation.control_count")),
            "initial_shots_count": value.get("photos.photographs"),
            "reconstructed_shots_count": value.get("orientation.photos_oriented"),
            "reconstructed_points_count": value.get("orientation.tie_points"),
            "observations_count": value.get("orientation.image_measurements"),
            "average_track_length": value.get("orientation.rays_per_point"),
            "reprojection_error_pixels": value.get("orientation.sigma0_px"),
        },
        "gcp_errors": _control_errors(control),
        "point_cloud_statistics": _cloud_figures(cloud),
        "odm_processing_statistics": {
            "total_time": value.get("run.wall_seconds"),
            "average_gsd": _times(100.0, value.get("texture.photo_ground_pixel")),
        },
    }
    return {room: {name: one for name, one in own.items() if one is not None} for room, own in figures.items()}


def _times(factor: float, value: float | None) -> float | None:
    return None if value is None else factor * value


def _area(value: dict[str, Any]) -> float | None:
    """m2 of ground with heights."""
    cells, cell = value.get("densification.cells_with_height"), value.get("densification.cell")
    return cells * cell**2 if cells and cell else None


def _days(shots: Path | None) -> dict[str, str | None]:
    """When the first and the last photograph was taken."""
    known = [feature["properties"].get("capture_time") for feature in _features(shots)]
    times = [time for time in known if time is not None]
    if not times:
        return {}
    first, last = (datetime.fromtimestamp(time, UTC).strftime(_MOMENT) for time in (min(times), max(times)))
    return {"start_date": first, "end_date": last}


def _control_errors(control: Path | None) -> dict[str, Any]:
    """Means and root mean squares (m) of the differences at control points, and their mean length."""
    errors = [one["properties"]["error"] for one in _features(control) if one["properties"]["role"] == "control"]
    if not errors:
        return {}
    axes = dict(zip("xyz", zip(*errors, strict=True), strict=True))
    return {
        "average_error": math.fsum(math.hypot(*error) for error in errors) / len(errors),
        "mean": {axis: math.fsum(own) / len(own) for axis, own in axes.items()},
        "error": {axis: math.hypot(*own) / math.sqrt(len(own)) for axis, own in axes.items()},
    }


def _cloud_figures(cloud: Path | None) -> dict[str, Any]:
    if cloud is None:
        return {"dense": False}
    import laspy

    try:
        with laspy.open(cloud) as reader:
            header = reader.header
    except (laspy.LaspyException, OSError):
        # Figures are for show: for want of one no delivery fails.
        return {"dense": False}
    ends = dict(zip("xyz", zip(header.mins.tolist(), header.maxs.tolist(), strict=True), strict=True))
    sides = {f"{word}{axis}": own[end] for end, word in enumerate(("min", "max")) for axis, own in ends.items()}
    statistic = [
        {"name": axis.upper(), "position": number, "count": header.point_count, "minimum": low, "maximum": high}
        for number, (axis, (low, high)) in enumerate(ends.items())
    ]
    return {"dense": True, "stats": {"statistic": statistic, "bbox": {"native": {"bbox": sides}}}}


def _features(path: Path | None) -> list[dict[str, Any]]:
    return json.loads(path.read_text())["features"] if path else []
