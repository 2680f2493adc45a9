"""The exterior orientation of photographs and the result of the block adjustment."""

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, field_validator

from orthomill.schemas.camera import Camera, padded
from orthomill.schemas.errors import PhotoError
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.job import Table


class ExteriorOrientation(BaseModel):
    """Where a photograph was taken and which way it looked. R = R3(kappa) R2(phi) R1(omega), world to image."""

    model_config = ConfigDict(frozen=True)

    photo: str
    centre: tuple[float, float, float]
    """X, Y, Z, m"""
    # Degrees for people, but radians in the covariance, where they match the derivatives of the collinearity equations.
    omega_phi_kappa: tuple[float, float, float]
    """degrees"""
    covariance: tuple[tuple[float, ...], ...] | None = None
    """6 x 6 of (X, Y, Z, omega, phi, kappa) in m and radians"""
    observations: int = 0
    residual_px: float | None = None
    """root mean square of its image residuals"""
    # Over flat ground c and the flying height compensate each other: propagating them as independent would count one error twice.
    with_interior: dict[str, tuple[tuple[float, ...], ...]] = {}
    """camera -> 6 x 17: covariance with the interior orientation of the camera (order of INTERIOR, px); for cameras that were
    adjusted in the block"""

    @field_validator("with_interior")
    @classmethod
    def _all_parameters(cls, value: dict[str, tuple[tuple[float, ...], ...]]) -> dict[str, tuple[tuple[float, ...], ...]]:
        """Blocks of earlier versions have columns for the first eight interior parameters only."""
        return {camera: padded(rows) for camera, rows in value.items()}


class Unoriented(BaseModel):
    """A photograph that did not join the block, and why."""

    model_config = ConfigDict(frozen=True)

    photo: str
    reason: str


class JointCovariance(BaseModel):
    """The covariance between two photographs or two cameras. Errors that both share, such as those of a poorly determined datum,
    cancel in relative quantities."""

    model_config = ConfigDict(frozen=True)

    first: str
    second: str
    covariance: tuple[tuple[float, ...], ...]
    """photographs: 6 x 6, rows X, Y, Z, omega, phi, kappa of the first, columns those of the second; m and radians"""

    @field_validator("covariance")
    @classmethod
    def _all_parameters(cls, value: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        """As of `ExteriorOrientation`; between photographs it has six columns and stays as it is."""
        return padded(value)


Area = tuple[float, float, float, float]
"""West, south, east and north of a part of the map, or of the plane that stands for it, m"""


def in_area(area: Area | None, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which of the places x, y (N,) m lie in an area (N,) bool; all of them where there is none."""
    if area is None:
        return np.ones(len(x), bool)
    west, south, east, north = area
    return (x >= west) & (x <= east) & (y >= south) & (y <= north)


class Block(BaseModel):
    """A block of photographs, oriented in the project's CRS."""

    model_config = ConfigDict(frozen=True)

    crs: str
    cameras: dict[str, Camera]
    of_photo: dict[str, str]
    """photo -> camera"""
    photos: tuple[ExteriorOrientation, ...]
    unoriented: tuple[Unoriented, ...] = ()
    datum: str
    """control, gnss or free, as one sentence"""
    sigma0_px: float
    # sigma0 is only as reliable as the redundancy behind it, so that the two are stored together.
    redundancy: int
    iterations: int
    ground_low: float
    ground_high: float
    """robust range of tie point heights, m"""
    area: Area | None = None
    """where a surface is made, where it stands on a plane; None: wherever pairs see ground"""
    # By pairs, because the full covariance matrix grows with the square of the number of photographs.
    joint: tuple[JointCovariance, ...] = ()
    """of all pairs of photographs that share tie points"""
    joint_cameras: tuple[JointCovariance, ...] = ()
    """of all pairs of adjusted cameras: 17 x 17 in the order of INTERIOR"""
    groups: tuple[tuple[str, ...], ...] = ()
    """photographs that tie points connect, the largest group first; only positions and control connect several groups"""

    @property
    def ground_mean(self) -> float:
        """Mean height of the ground, m."""
        return 0.5 * (self.ground_low + self.ground_high)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the photographs, in the order of `photos`."""
        return tuple(photo.photo for photo in self.photos)

    def of(self, name: str) -> ExteriorOrientation:
        """The orientation of a photograph of the block (`check_holds` asks whether it is one)."""
        return next(photo for photo in self.photos if photo.photo == name)

    def check_holds(self, name: str) -> None:
        """Raises PhotoError for a photograph that is not in the block."""
        if name not in self.names:
            more = " ..." if len(self.names) > 8 else ""
            raise PhotoError(f"{name} is not in the block; it holds {', '.join(self.names[:8])}{more}.")

    def camera_of(self, name: str) -> Camera:
        """The camera of a photograph of the block."""
        return self.cameras[self.of_photo[name]]


BLOCK = Table("orientation/block.json", Block)


class RelativeOrientation(BaseModel):
    """The orientation of the right photograph of a pair relative to the left one, up to the length of the base.

    `base` is a unit vector in the image system of the left photograph, `omega_phi_kappa` (degrees) turn it into the right one's:
    R = R3(kappa) R2(phi) R1(omega). Parameters and standard errors of the dependent relative orientation follow where the base lies
    along x.
    """

    model_config = ConfigDict(frozen=True)

    left: str
    right: str
    matches: int
    kept: int
    outcome: str
    """"oriented", or a sentence why not"""
    base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    omega_phi_kappa: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # Five: images alone do not determine the length of the base.
    sigma: tuple[float, float, float, float, float] | None = None
    """standard errors: two of the base's direction across itself, three of the rotation about the axes of the right image;
    degrees"""
    # The classical parameters divide by b_x and lose their meaning where the base lies across the x axis or along the view.
    by_bz: tuple[float, float] | None = None
    """b_y and b_z for b_x = 1, where the base lies mainly along x"""
    sigma0_px: float | None = None
    intersection_deg: float = 0.0
    """median angle at which homologous rays meet"""
    same_photo: bool = False
    """both are the same photograph, given twice"""

    @property
    def oriented(self) -> bool:
        return self.outcome == "oriented"


class RelativeOrientations(BaseModel):
    """All pairs of photographs that share tie points."""

    model_config = ConfigDict(frozen=True)

    pairs: tuple[RelativeOrientation, ...] = ()
    start_k1: dict[str, float] = {}
    """nominal camera -> approximate k1 with which its pairs fit; empty where they fit without"""


class GroundResidual(BaseModel):
    """A control or check point, or a GNSS position, against the adjusted block: block minus given, m."""

    model_config = ConfigDict(frozen=True)

    name: str
    role: str
    """control, check or position"""
    difference: tuple[float, float, float]
    predicted: tuple[float, float, float]
    """standard error of the difference that the adjustment predicts, m"""
    photos: int
    """photographs in which it was measured (1 for a position)"""
    residual_px: float | None = None
    """root mean square of its image residuals"""
    redundancy: tuple[float, float, float] | None = None
    """share of an error of each coordinate that its difference shows; None where the whole of it shows"""
    sigma: tuple[float, float, float] | None = None
    """m: standard error with which each coordinate took part; None: it took no part"""


class DistanceResidual(BaseModel):
    """A measured distance against the adjusted block: block minus given, m."""

    model_config = ConfigDict(frozen=True)

    first: str
    second: str
    length: float
    """on the map, where something tells its scale"""
    difference: float
    predicted: float
    """standard error of the difference that the adjustment predicts, m"""
    measured: float | None = None
    """m: on the ground, as the file states it; None where `length` is that"""
    role: Literal["control", "check"] = "control"
    """`check`: an end is a check point, so that the distance takes no part in the adjustment"""
    redundancy: float | None = None
    """share of an error of the distance that its difference shows; None where it took no part"""
    sigma: float | None = None
    """m: standard error with which it took part"""


class JointTest(BaseModel):
    """All coordinates of all check points at once against what is predicted for them together: the orientation moves them alike, so
    that many points of one error are no more than one."""

    model_config = ConfigDict(frozen=True)

    square: float
    """of the differences, in their joint covariance: expected to be `coordinates`, and distributed as chi-squared"""
    coordinates: int
    chance: float
    """with which a square as large or larger comes about where the predictions hold"""


class GroundResiduals(BaseModel):
    """Differences of the block from control points, check points, GNSS positions and measured distances."""

    model_config = ConfigDict(frozen=True)

    points: tuple[GroundResidual, ...] = ()
    distances: tuple[DistanceResidual, ...] = ()
    checked: JointTest | None = None
    """of the check points; None without any, and of a block that is fixed and states no covariance"""

    def of_role(self, role: str) -> tuple[GroundResidual, ...]:
        """The points of one role: control or check."""
        return tuple(point for point in self.points if point.role == role)


class ParameterCorrelation(BaseModel):
    """Two strongly correlated unknowns, which the observations can hardly separate."""

    model_config = ConfigDict(frozen=True)

    first: str
    second: str
    value: float


class GroupReliability(BaseModel):
    """How well errors of single observations of a group would have been found: px for what was measured in photographs, else m."""

    model_config = ConfigDict(frozen=True)

    detectable: float | None
    """smallest error that the test at 0.1 % finds with 80 % (inner reliability), median of the group; None: nothing checks it"""
    detectable_most: float | None
    """the same, of the observation that is checked worst"""
    effect: float | None
    """what an error of that size, not found, does to the adjusted value of its observation (external reliability), median"""
    effect_most: float | None
    unchecked: int
    """observations that nothing checks"""


class ObservationGroup(BaseModel):
    """A group of observations with its variance component."""

    model_config = ConfigDict(frozen=True)

    name: str
    count: int
    """scalar observations"""
    # Not an integer: single redundancy numbers lie between 0 and 1, and only their sum over all groups is the whole redundancy.
    redundancy: float
    """its part of the redundancy: the sum of its redundancy numbers"""
    factor: float
    """estimated by stated standard error"""
    part: str = ""
    """which of several groups with this name: the receiver, the kind of its solutions"""
    reliability: GroupReliability | None = None


class SourceStatement(BaseModel):
    """What a source says of a parameter of the block by itself, relative to the block, and what all others say without it."""

    model_config = ConfigDict(frozen=True)

    source: str
    parameter: str
    unit: str
    value: float
    sigma: float
    others: float | None = None
    """None: the others do not determine it"""
    others_sigma: float | None = None

    @property
    def ratio(self) -> float | None:
        """Their difference in standard errors."""
        if self.others is None or self.others_sigma is None:
            return None
        return abs(self.value - self.others) / max(float(np.hypot(self.sigma, self.others_sigma)), 1e-300)


class PositionOffset(BaseModel):
    """A constant error of positions that was adjusted: of which photographs, in which coordinate (0 to 2), m."""

    model_config = ConfigDict(frozen=True)

    photos: tuple[str, ...]
    axis: int
    value: float
    sigma: float


class PositionDrift(BaseModel):
    """How the positions of a flight move evenly against the block, from its first photograph to its last, m in X, Y, Z: what an
    unknown of the adjustment would be, which it is not; None where the block would follow all of it."""

    model_config = ConfigDict(frozen=True)

    photos: tuple[str, ...]
    """in the order of time"""
    hours: float
    value: tuple[float | None, float | None, float | None]
    sigma: tuple[float | None, float | None, float | None]
    freedom: float
    """observations that the scatter of the positions is known from"""


class LeverArm(BaseModel):
    """From the projection centre to the antenna of one of several receivers, in the image system, m: x right,
    y up, z backwards."""

    model_config = ConfigDict(frozen=True)

    receiver: str
    """serial number of the camera or its drone; "" for photographs without one"""
    value: tuple[float, float, float]
    sigma: tuple[float, float, float] | None = None
    """None: taken as exactly known"""


class LargestResidual(BaseModel):
    """One of the image measurements with the largest standardised residuals, of those that took part."""

    model_config = ConfigDict(frozen=True)

    point: str
    """name of a surveyed point, or "tie point" and its number"""
    photo: str
    axis: str
    """x or y, image coordinates"""
    residual_px: float
    standardised: float
    # Near 0 the residual hardly shows a gross error: a small residual then says nothing about its measurement.
    redundancy_number: float
    """the share of an error of this measurement that its own residual shows"""
    detectable_px: float
    """the smallest gross error of it that the test detects (inner reliability)"""


class BlockPrecision(BaseModel):
    """The results of the adjustment beyond the block itself: precision and reliability of the observations, blunders, findings."""

    model_config = ConfigDict(frozen=True)

    image_factor: float
    """estimated by stated standard error of the image measurements"""
    position_factor: float
    """the largest of its groups"""
    control_factor: float
    rays: int
    rejected: int
    # Estimated once for all positions: absolute GNSS errors change little during a flight and would otherwise deform the block.
    gnss_shift: tuple[float, float, float] | None = None
    gnss_shift_sigma: tuple[float, float, float] | None = None
    correlations: tuple[ParameterCorrelation, ...] = ()
    """of 0.9 or more"""
    findings: tuple[BlockFinding, ...] = ()
    """about datum, cameras, contradictions and connection; the report puts them into words"""
    # z backwards, as the camera looks along -z: an antenna above a camera that looks down has a positive z.
    lever_arm: tuple[float, float, float] | None = None
    """from the projection centre to the antenna in the image system (x right, y up, z backwards), m; None: not used"""
    lever_arm_sigma: tuple[float, float, float] | None = None
    lever_arms: tuple[LeverArm, ...] = ()
    """those of several receivers, instead of one for all"""
    offsets: tuple[PositionOffset, ...] = ()
    """constant errors of positions, where they are not one common shift"""
    drifts: tuple[PositionDrift, ...] = ()
    """of each flight whose photographs have times"""
    sources: tuple[SourceStatement, ...] = ()
    """what each source says by itself; empty for a free block"""
    groups: tuple[ObservationGroup, ...] = ()
    largest: tuple[LargestResidual, ...] = ()
    """largest standardised residuals, the worst first"""
    blunders: tuple[str, ...] = ()
    """names of the positions, control points and distances that contradicted the block and took no part"""
    common_px: float | None = None
    """correlated image errors, root mean square over the frame; None where the residuals are those of white noise"""
    common_share: float | None = None
    """the part of their variance which is the same in all photographs of a camera"""
    bend_sigma: float | None = None
    """standard error of the range of heights that a bend of the ground adds over `bend_extent`, m; None: too few tie points"""
    bend_extent: float | None = None
    """length of the block, m"""
    # Kept for comparison with programs that assume independent image errors.
    white_sigma: dict[str, tuple[float, ...]] = {}
    """camera -> standard errors of its interior parameters (order of INTERIOR) under the assumption of white noise"""


class SeparateBlocks(BaseModel):
    """Groups of photographs that nothing connects to the project's reference system: each is a free block."""

    model_config = ConfigDict(frozen=True)

    blocks: tuple[Block, ...] = ()


RELATIVE = Table("orientation/relative.json", RelativeOrientations)
GROUND_RESIDUALS = Table("orientation/ground_residuals.json", GroundResiduals)
BLOCK_PRECISION = Table("orientation/precision.json", BlockPrecision)
SEPARATE_BLOCKS = Table("orientation/separate_blocks.json", SeparateBlocks)
