"""The job of the registration: from the texts of scans and control to registered scans, points and residuals."""

from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Columns, Table
from orthomill.schemas.observations import RegisteredPoints
from orthomill.tasks.adjustment.registration.joint_registration import Registration, register
from orthomill.tasks.adjustment.registration.scan_network import ScannedPoints, ScanNetwork
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.rotation_vector import angles_from_vector
from orthomill.tasks.registration.scan_files import SurveyedTarget, Target, read_scan, read_surveyed


class RegisteredScan(BaseModel):
    """A scan in the project's system: X = rotation x + translation. Angles, degrees, are those of this
    rotation; `covariance` (6 x 6) is that of X, Y, Z and the three angles, m and radians."""

    model_config = ConfigDict(frozen=True)

    name: str
    rotation: tuple[tuple[float, float, float], ...]
    translation: tuple[float, float, float]
    omega_phi_kappa: tuple[float, float, float]
    covariance: tuple[tuple[float, ...], ...]
    targets: int
    rms_m: float


class RejectedTarget(BaseModel):
    """A target that contradicts the others: rejected in these scans, or its control coordinates where there are none."""

    model_config = ConfigDict(frozen=True)

    name: str
    scans: tuple[str, ...]
    size_m: float
    misfit: float


class CheckedTarget(BaseModel):
    """A check point: registered minus surveyed, and the standard errors of these differences, m."""

    model_config = ConfigDict(frozen=True)

    name: str
    difference: tuple[float, float, float]
    sigma: tuple[float, float, float]


class RegisteredScans(BaseModel):
    """The result of the joint registration; `datum`: control, or the name of the scan that defines the system."""

    model_config = ConfigDict(frozen=True)

    scans: tuple[RegisteredScan, ...]
    datum: str
    sigma0_m: float
    redundancy: int
    scan_factor: float
    control_factor: float
    rejected: tuple[RejectedTarget, ...]
    checked: tuple[CheckedTarget, ...]
    control: int
    tie: int
    iterations: int


@dataclass(frozen=True)
class TargetResiduals(Columns):
    """One row per target of a scan, in the order of the files."""

    scan: np.ndarray
    name: np.ndarray
    """str"""
    v_x: np.ndarray
    v_y: np.ndarray
    v_z: np.ndarray
    """float64 m: adjusted minus scanned, along the axes of the scan"""
    standardised: np.ndarray
    """float64: size of the misfit in standard errors of its own; NaN where nothing checks it or it was rejected"""
    used: np.ndarray
    """bool"""


class RegistrationTables(NamedTuple):
    """What the job writes."""

    scans: RegisteredScans
    points: RegisteredPoints
    residuals: TargetResiduals


REGISTERED_SCANS = Table("registration/scans.json", RegisteredScans)
TARGET_RESIDUALS = Table("registration/residuals.parquet", TargetResiduals)

Scans = dict[str, dict[str, Target]]
"""scan -> target -> coordinates"""


def scan_name(path: str) -> str:
    """What a scan is called: its file without folder and extension."""
    return PurePosixPath(path).stem


def register_scans(
    texts: tuple[str, ...], paths: tuple[str, ...], sigma: float, rejection: float, surveyed: str | None = None
) -> RegistrationTables:
    """All scans in the system of the control text `surveyed`, or of the first scan. `sigma` m: standard error of targets without
    their own. Raises WorkflowError for mistakes in the files, GeometryError where the scans cannot be registered."""
    scans: Scans = {scan_name(path): read_scan(text, path, sigma) for path, text in zip(paths, texts, strict=True)}
    if len(scans) < len(paths):
        raise WorkflowError("Two scans have the same name; name their files differently, whatever their folders are.")
    known = {} if surveyed is None else read_surveyed(surveyed)
    names = tuple(dict.fromkeys(name for targets in scans.values() for name in targets))
    strangers = [name for name in known if name not in names]
    if known and len(strangers) == len(known):
        raise WorkflowError(
            f"None of the {len(known)} control points is in a scan: {', '.join(strangers[:5])}; the scans hold "
            f"{', '.join(names[:5])}. Give targets the same names in all files."
        )
    network, points = _observed(scans, known, names)
    result = register(network, points, tuple(scans), rejection)
    return RegistrationTables(
        _summary(result, tuple(scans), known, names), _points(result, known, names), _residuals(result, tuple(scans), names)
    )


def _observed(scans: Scans, known: dict[str, SurveyedTarget], names: tuple[str, ...]) -> tuple[ScanNetwork, ScannedPoints]:
    number = {name: i for i, name in enumerate(names)}
    rows = [(k, number[name], target) for k, targets in enumerate(scans.values()) for name, target in targets.items()]
    control, weight = np.zeros((len(names), 3)), np.zeros((len(names), 3))
    for name, target in known.items():
        if name in number and target.role == "control":
            control[number[name]], weight[number[name]] = target.xyz, np.array(target.sigma) ** -2.0
    points = ScannedPoints(
        np.array([k for k, _, _ in rows]),
        np.array([i for _, i, _ in rows]),
        np.array([target.xyz for _, _, target in rows]),
        np.array([target.sigma for _, _, target in rows]),
    )
    return ScanNetwork(len(scans), len(names), control, weight), points


def _summary(
    result: Registration, scans: tuple[str, ...], known: dict[str, SurveyedTarget], names: tuple[str, ...]
) -> RegisteredScans:
    surveyed = result.network.weight.any(axis=1)
    rejected = tuple(
        RejectedTarget(
            name=names[b.point], scans=tuple(scans[k] for k in b.scans), size_m=round(b.size, 5), misfit=round(b.misfit, 2)
        )
        for b in result.blunders
    )
    number = {name: i for i, name in enumerate(names)}
    checked = tuple(
        _checked(result, name, target, number[name]) for name, target in known.items() if target.role == "check" and name in number
    )
    return RegisteredScans(
        scans=tuple(_scan(result, k, name) for k, name in enumerate(scans)),
        datum=scans[0] if result.network.free else "control",
        sigma0_m=result.sigma0,
        redundancy=result.redundancy,
        scan_factor=result.factor,
        control_factor=result.control_factor,
        rejected=rejected,
        checked=checked,
        control=int(surveyed.sum()),
        tie=int((np.bincount(result.points.point[result.used], minlength=len(names))[~surveyed] > 1).sum()),
        iterations=result.iterations,
    )


def _scan(result: Registration, number: int, name: str) -> RegisteredScan:
    R, own = result.state.rotation[number], result.used & (result.points.scan == number)
    by_angle = np.eye(6)
    by_angle[3:, 3:] = angles_from_vector(R)
    covariance = by_angle @ result.scan_covariance(number) @ by_angle.T
    omega, phi, kappa = np.degrees(angles(R)).tolist()
    return RegisteredScan(
        name=name,
        rotation=tuple((a, b, c) for a, b, c in R.tolist()),
        translation=_triple(result.state.translation[number]),
        omega_phi_kappa=(omega, phi, kappa),
        covariance=tuple(map(tuple, covariance.tolist())),
        targets=int(own.sum()),
        rms_m=float(np.sqrt((result.residual[own] ** 2).mean())) if own.any() else 0.0,
    )


def _checked(result: Registration, name: str, target: SurveyedTarget, number: int) -> CheckedTarget:
    variance = np.diag(result.point_covariance[number]) + np.array(target.sigma) ** 2
    return CheckedTarget(
        name=name, difference=_triple(result.state.point[number] - np.array(target.xyz)), sigma=_triple(np.sqrt(variance))
    )


def _points(result: Registration, known: dict[str, SurveyedTarget], names: tuple[str, ...]) -> RegisteredPoints:
    shown = np.bincount(result.points.point[result.used], minlength=len(names))
    # A target that no scan shows any more has no place of its own.
    kept = np.flatnonzero(shown > 0)
    covariance, xyz = result.point_covariance[kept], result.state.point[kept]
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    surveyed = np.any(result.network.weight, axis=1)
    roles = ["control" if surveyed[i] else "check" if names[i] in known else "tie" for i in kept]
    return RegisteredPoints(
        name=np.array([names[i] for i in kept], str),
        role=np.array(roles, str),
        x=xyz[:, 0],
        y=xyz[:, 1],
        z=xyz[:, 2],
        sigma_x=sigma[:, 0],
        sigma_y=sigma[:, 1],
        sigma_z=sigma[:, 2],
        cov_xy=covariance[:, 0, 1],
        cov_xz=covariance[:, 0, 2],
        cov_yz=covariance[:, 1, 2],
        scans=shown[kept].astype(np.int16),
    )


def _residuals(result: Registration, scans: tuple[str, ...], names: tuple[str, ...]) -> TargetResiduals:
    points = result.points
    return TargetResiduals(
        scan=np.array([scans[k] for k in points.scan], str),
        name=np.array([names[i] for i in points.point], str),
        v_x=result.residual[:, 0],
        v_y=result.residual[:, 1],
        v_z=result.residual[:, 2],
        standardised=result.standardised,
        used=result.used,
    )


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
