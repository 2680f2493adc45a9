"""The adjustment as an authority asks for it: correlations of cameras, precision of photographs, reliability of control."""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns, Table
from orthomill.schemas.orientation import LeverArm, ObservationGroup, PositionDrift, PositionOffset


class _Part(BaseModel):
    """Base of its parts."""

    model_config = ConfigDict(frozen=True)


class InteriorStatement(_Part):
    """The interior orientation of a camera with standard errors and correlations."""

    camera: str
    source: str
    parameters: tuple[str, ...]
    """those that have a standard error"""
    values: tuple[float, ...]
    sigmas: tuple[float, ...]
    """c, x0, y0 in px, the others without unit"""
    correlations: tuple[tuple[float, ...], ...]
    """(n, n)"""


class SurveyedReliability(_Part):
    """How well an error of one coordinate of a control point or a GNSS position, or of a measured distance, would have been found,
    and what it does unfound."""

    point: str
    axis: str
    sigma: float
    """m, with which it took part: as stated, or enlarged where the group contradicts the rest; of a distance to a check point that
    of its difference from the block"""
    redundancy: float
    """share of an error that its residual shows"""
    detectable: float | None
    """m: smallest error that the test at 0.1 % finds with 80 % (inner reliability); None: nothing checks it"""
    effect: float | None
    """m: what an error of that size, not found, does to the adjusted coordinate or length (external reliability)"""


class AdjustmentStatement(_Part):
    """Cameras, groups of observations with their variance components and reliability, control, and what was found of receivers."""

    cameras: tuple[InteriorStatement, ...] = ()
    groups: tuple[ObservationGroup, ...] = ()
    control: tuple[SurveyedReliability, ...] = ()
    distances: tuple[SurveyedReliability, ...] = ()
    """those that took part"""
    check_distances: tuple[SurveyedReliability, ...] = ()
    """those to check points: the whole of an error shows, and nothing of it is in the block"""
    gnss_shift: tuple[float, float, float] | None = None
    """m: constant error of all GNSS positions; None: not adjusted"""
    gnss_shift_sigma: tuple[float, float, float] | None = None
    gnss_offsets: tuple[PositionOffset, ...] = ()
    """constant errors of the positions of a flight, where they are not one for all"""
    gnss_drifts: tuple[PositionDrift, ...] = ()
    """how the positions of a flight move against the block; tested, not adjusted"""
    lever_arms: tuple[LeverArm, ...] = ()
    """of each receiver; empty: none was given or adjusted"""


@dataclass(frozen=True)
class ExteriorPrecision(Columns):
    """Standard errors and correlations of every exterior orientation, one photograph a row."""

    photo: np.ndarray
    """str"""
    sigma_x: np.ndarray
    sigma_y: np.ndarray
    sigma_z: np.ndarray
    """float64 m"""
    sigma_omega: np.ndarray
    sigma_phi: np.ndarray
    sigma_kappa: np.ndarray
    """float64 degrees"""
    x_y: np.ndarray
    x_z: np.ndarray
    x_omega: np.ndarray
    x_phi: np.ndarray
    x_kappa: np.ndarray
    y_z: np.ndarray
    y_omega: np.ndarray
    y_phi: np.ndarray
    y_kappa: np.ndarray
    z_omega: np.ndarray
    z_phi: np.ndarray
    z_kappa: np.ndarray
    omega_phi: np.ndarray
    omega_kappa: np.ndarray
    phi_kappa: np.ndarray
    """float64, correlations"""


@dataclass(frozen=True)
class InteriorCorrelation(Columns):
    """Correlations of the interior parameters, one pair of parameters a row."""

    camera: np.ndarray
    first: np.ndarray
    second: np.ndarray
    """str"""
    correlation: np.ndarray
    """float64"""


@dataclass(frozen=True)
class SurveyedReliabilities(Columns):
    """The same for every control point, GNSS position and distance, one coordinate or length a row."""

    kind: np.ndarray
    """str: control, position, distance, or check distance: one that took no part"""
    name: np.ndarray
    axis: np.ndarray
    """str"""
    sigma: np.ndarray
    redundancy: np.ndarray
    detectable: np.ndarray
    effect: np.ndarray
    """float64: m, share, m, m; NaN where nothing checks it"""


ADJUSTMENT_STATEMENT = Table("accuracy/adjustment.json", AdjustmentStatement)
EXTERIOR_PRECISION = Table("accuracy/exterior_precision.parquet", ExteriorPrecision)
SURVEYED_RELIABILITY = Table("accuracy/surveyed_reliability.parquet", SurveyedReliabilities)
INTERIOR_CORRELATION = Table("accuracy/interior_correlation.parquet", InteriorCorrelation)
