"""The numbers of the report: precision of places and points, check points, and the largest residuals."""

import numpy as np

from orthomill.schemas.observations import RegisteredPoints
from orthomill.tasks.registration.registered_scans import RegisteredScan, RegisteredScans, TargetResiduals


def mean_sigma(points: RegisteredPoints) -> float:
    """Standard error of a registered coordinate, root mean square, m."""
    return float(np.sqrt(np.mean([points.sigma_x**2, points.sigma_y**2, points.sigma_z**2])))


def check_rms(scans: RegisteredScans) -> float | None:
    """Of the coordinates of the check points, registered minus surveyed, m; None without any."""
    away = [point.difference for point in scans.checked]
    return float(np.sqrt(np.mean(np.square(away)))) if away else None


def place_sigmas(scan: RegisteredScan) -> tuple[float, ...]:
    """Standard errors of X, Y and Z of the scan's origin, m."""
    return tuple(np.sqrt(np.maximum(np.diag(np.array(scan.covariance))[:3], 0.0)).tolist())


def largest_residuals(residuals: TargetResiduals, most: int) -> list[int]:
    """Rows of the largest standardised residuals of what took part, the largest one first."""
    size = np.where(residuals.used, np.nan_to_num(residuals.standardised), 0.0)
    return [int(i) for i in np.argsort(-size, kind="stable")[:most] if size[i] > 0]
