"""What the orientation of a block found out that a reader must know: a code with its names and numbers, never a sentence.

Tables carry these values; the report of the stage turns each of them into words. Programs that read the tables compare
codes and numbers, and a translation needs the report only.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]


class _Finding(BaseModel):
    model_config = ConfigDict(frozen=True)


class NoDatum(_Finding):
    """A free network; `scaled`: measured distances give its scale."""

    code: Literal["no_datum"] = "no_datum"
    scaled: bool


class PositionsCrowded(_Finding):
    """The positions lie closer together than their own standard errors."""

    code: Literal["positions_crowded"] = "positions_crowded"


class TiltUnobserved(_Finding):
    """Positions and control lie nearly on one line, and an assumption determines the tilt about it."""

    code: Literal["tilt_unobserved"] = "tilt_unobserved"
    tilt_sigma_deg: float | None
    """standard error of the tilt from positions and control alone; None: they say nothing of it"""
    basis: Literal["attitude", "down", "level"]
    """where the up direction comes from"""
    sigma_deg: float
    """standard error of the tilt with the up direction"""


class ControlOnALine(_Finding):
    """The control points lie nearly on one line."""

    code: Literal["control_on_a_line"] = "control_on_a_line"


class DatumMisfit(_Finding):
    """Positions and control do not fit the shape of the block."""

    code: Literal["datum_misfit"] = "datum_misfit"
    ratio: float
    """median misfit before the adjustment, in standard errors"""


class LooksUpward(_Finding):
    """By the control the photographs look upwards from below the ground."""

    code: Literal["looks_upward"] = "looks_upward"


class AxesExchanged(_Finding):
    """The control fits with X and Y exchanged only."""

    code: Literal["axes_exchanged"] = "axes_exchanged"
    exchanged_m: float
    given_m: float
    """root mean square misfits"""


class DistortionFolds(_Finding):
    """The radial distortion of a camera cannot be inverted in the corners of its frame."""

    code: Literal["distortion_folds"] = "distortion_folds"
    camera: str
    reach_px: float
    """largest radius that can be undone"""
    corner_px: float
    """radius of the farthest corner"""
    k1: float
    c: float


class InteriorUndetermined(_Finding):
    """The geometry does not determine c, x0, y0 of a camera, which kept their values."""

    code: Literal["interior_undetermined"] = "interior_undetermined"
    camera: str
    share: float | None
    """predicted standard error in units of c; None: the normal equations are singular"""


class InteriorFixed(_Finding):
    """The adjustment failed with free interior orientations, which were all fixed."""

    code: Literal["interior_fixed"] = "interior_fixed"
    cameras: tuple[str, ...]


class ConstantContradicted(_Finding):
    """The block contradicts the camera constant that was given."""

    code: Literal["constant_contradicted"] = "constant_contradicted"
    camera: str
    given_px: float
    adjusted_px: float
    sigma_px: float
    fixed: bool
    """the workflow fixes the interior orientation, so the given value was kept"""


class ConstantNominal(_Finding):
    """A nominal camera constant kept its value, and its uncertainty reached the heights."""

    code: Literal["constant_nominal"] = "constant_nominal"
    camera: str
    c: float
    share: float
    """its standard error in units of c"""


class PrincipalPointMoved(_Finding):
    """The principal point left its given place by many standard errors."""

    code: Literal["principal_point_moved"] = "principal_point_moved"
    camera: str
    moved_px: float


class ImageErrorsCorrelated(_Finding):
    """Neighbouring image measurements err alike, which makes standard errors notably larger."""

    code: Literal["image_errors_correlated"] = "image_errors_correlated"
    rms_px: float
    camera_share: float
    """the part of the variance that all photographs of a camera have in common"""
    parameter: str
    owner: str
    """camera or photograph whose `parameter` loses most precision"""
    sigma: float
    white_sigma: float
    """its standard error with the correlation, and under the assumption of white noise"""


class ControlContradicted(_Finding):
    """A control point was left out because it contradicts the block."""

    code: Literal["control_contradicted"] = "control_contradicted"
    point: str
    difference: Vector
    """block minus given, m"""
    ratio: float
    """its largest component in predicted standard errors"""


class PositionContradicted(_Finding):
    """The position of a photograph was left out because it contradicts the block."""

    code: Literal["position_contradicted"] = "position_contradicted"
    photo: str
    difference: Vector
    ratio: float


class PositionsElsewhere(_Finding):
    """Many positions contradict the block together."""

    code: Literal["positions_elsewhere"] = "positions_elsewhere"
    photos: int
    distance_m: float
    """length of the median difference"""


class PositionsAlongView(_Finding):
    """Positions and control contradict each other along the viewing direction only."""

    code: Literal["positions_along_view"] = "positions_along_view"
    photos: int
    along_m: float


class DistanceContradicted(_Finding):
    """A measured distance contradicts the block."""

    code: Literal["distance_contradicted"] = "distance_contradicted"
    first: str
    second: str
    length: float
    difference: float
    """block minus given, m"""
    ratio: float
    """difference in predicted standard errors"""
    outcome: Literal["excluded", "undecided", "downweighted"]
    """left out; kept, because nothing shows which observation is wrong; kept with a larger standard error"""


class DistanceUnchecked(_Finding):
    """One distance alone gives the scale."""

    code: Literal["distance_unchecked"] = "distance_unchecked"


class Misfit(BaseModel):
    """A measurement in a photograph that does not fit; `lies_on`: the control point on which it lies instead."""

    model_config = ConfigDict(frozen=True)

    photo: str
    misfit_px: float
    lies_on: str | None = None


class MeasurementsRejected(_Finding):
    """Single measurements of a surveyed point took no part."""

    code: Literal["measurements_rejected"] = "measurements_rejected"
    role: Literal["control", "tie"]
    point: str
    measured: int
    rejected: tuple[Misfit, ...]


class CheckMeasurementsApart(_Finding):
    """Single measurements of a check point do not meet the others, which lie on its coordinates."""

    code: Literal["check_measurements_apart"] = "check_measurements_apart"
    point: str
    measured: int
    apart: tuple[Misfit, ...]


class GroupsUnconnected(_Finding):
    """No tie points connect these groups of photographs; each has a datum of its own. The largest comes first."""

    code: Literal["groups_unconnected"] = "groups_unconnected"
    groups: tuple[tuple[str, ...], ...]


class BlockSeparate(_Finding):
    """Photographs that form a free block of their own."""

    code: Literal["block_separate"] = "block_separate"
    photos: tuple[str, ...]


class CameraConstantsAveraged(_Finding):
    """A camera of another program has one camera constant for each axis; their mean was taken."""

    code: Literal["camera_constants_averaged"] = "camera_constants_averaged"
    camera: str
    x_px: float
    y_px: float
    error_px: float
    """error at the border of the frame"""


class LargestReconstruction(_Finding):
    """Of several reconstructions in a file the largest was read."""

    code: Literal["largest_reconstruction"] = "largest_reconstruction"
    count: int
    photos: int


class PhotosUnknown(_Finding):
    """Photographs of the block that was read which the project does not have."""

    code: Literal["photos_unknown"] = "photos_unknown"
    photos: tuple[str, ...]


class BlockElsewhere(_Finding):
    """A fixed block disagrees with the positions of its photographs."""

    code: Literal["block_elsewhere"] = "block_elsewhere"
    source: str
    offset: Vector
    """median of block minus given, m"""


class TiePointsMisfit(_Finding):
    """The project's tie points do not fit a fixed block."""

    code: Literal["tie_points_misfit"] = "tie_points_misfit"
    source: str
    rms_px: float
    factor: float
    """estimated by stated standard error"""


class BlockUnexamined(_Finding):
    """A fixed block without tie points that would examine it."""

    code: Literal["block_unexamined"] = "block_unexamined"
    source: str


BlockFinding = Annotated[
    NoDatum
    | PositionsCrowded
    | TiltUnobserved
    | ControlOnALine
    | DatumMisfit
    | LooksUpward
    | AxesExchanged
    | DistortionFolds
    | InteriorUndetermined
    | InteriorFixed
    | ConstantContradicted
    | ConstantNominal
    | PrincipalPointMoved
    | ImageErrorsCorrelated
    | ControlContradicted
    | PositionContradicted
    | PositionsElsewhere
    | PositionsAlongView
    | DistanceContradicted
    | DistanceUnchecked
    | MeasurementsRejected
    | CheckMeasurementsApart
    | GroupsUnconnected
    | BlockSeparate
    | CameraConstantsAveraged
    | LargestReconstruction
    | PhotosUnknown
    | BlockElsewhere
    | TiePointsMisfit
    | BlockUnexamined,
    Field(discriminator="code"),
]
