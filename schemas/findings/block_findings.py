"""Findings of the block orientation that a reader must know: a code with names and numbers, never a sentence.

Tables carry these values, and the report of the stage turns each of them into words. Programs that read the tables compare
codes and numbers, and a translation concerns the report only.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]


# The literal `code` of each class selects it when a table is read. Codes are therefore part of the file format and never change;
# names of classes may.
class _Finding(BaseModel):
    model_config = ConfigDict(frozen=True)


class NoDatum(_Finding):
    """A free network; `scaled`: measured distances give its scale, or positions an approximate one."""

    code: Literal["no_datum"] = "no_datum"
    scaled: bool
    scale_share: float | None = None
    """standard error of an approximate scale, in units of it; None: measured distances give it, or nothing does"""


class DatumGivenUp(_Finding):
    """With positions and control the adjustment did not converge: they pull against the tie points, `worst` most of all."""

    code: Literal["datum_given_up"] = "datum_given_up"
    worst: tuple[str, ...]
    """names of control points and photographs, the largest misfit first"""


class PositionsCrowded(_Finding):
    """The positions lie closer together than their own standard errors."""

    code: Literal["positions_crowded"] = "positions_crowded"


# Lists made on photographs of another size, or on the sensor's frame where EXIF turns the photograph, are wrong in all their lines.
class ControlUnmet(_Finding):
    """The rays of most control points do not meet where the tie points put the photographs."""

    code: Literal["control_unmet"] = "control_unmet"
    points: int
    measured: int
    """control points that are measured in two oriented photographs or more, all of them"""
    turned: bool
    """whether EXIF turns a photograph"""


class TiltUnobserved(_Finding):
    """Positions and control lie nearly on one line, and an assumption determines the tilt about it."""

    code: Literal["tilt_unobserved"] = "tilt_unobserved"
    # None where it is infinite: Infinity is no JSON, and other programs that read the tables need not accept it.
    tilt_sigma_deg: float | None
    """standard error of the tilt from positions and control alone; None: they do not determine it"""
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
    # A median: a single wrong position or point has a message of its own and must not look like a datum that does not fit.
    ratio: float
    """median misfit before the adjustment, in standard errors"""


class BlockBent(_Finding):
    """Heights bend over the block against its positions, or its photographs diverge from their attitudes."""

    code: Literal["block_bent"] = "block_bent"
    bend_m: float
    """from the middle of the block to its ends; negative: the ends are too low"""
    extent_m: float
    """of the photographs"""
    pixels: float
    """the bend in pixels on the ground"""
    scatter_m: float | None
    """of the positions about the bend; None: they show none"""
    views_deg: float | None
    """by which directions of view diverge from the attitudes over the block; None: they do not"""
    grave: bool
    """it is more than models of lenses leave"""
    sure: bool = True
    """it cannot be the receiver: attitudes show it, too, or positions scatter so little about it"""
    in_metres: bool = True
    """false: in the units of a block without a datum"""


class LooksUpward(_Finding):
    """According to the control, the photographs look up from below the ground."""

    code: Literal["looks_upward"] = "looks_upward"


class AxesExchanged(_Finding):
    """The control fits only with X and Y exchanged."""

    code: Literal["axes_exchanged"] = "axes_exchanged"
    # Geodetic systems often name the northing X and list it first. Both misfits are kept, to show how clear the case is.
    exchanged_m: float
    given_m: float
    """root mean square misfits"""


class DistortionFolds(_Finding):
    """The radial distortion of a camera cannot be inverted in the corners of its frame."""

    code: Literal["distortion_folds"] = "distortion_folds"
    camera: str
    reach_px: float
    """largest radius at which the distortion can be inverted"""
    corner_px: float
    """radius of the farthest corner"""
    # k1 refers to radii in units of c, so that its size means nothing in pixels without c.
    k1: float
    c: float


class InteriorUndetermined(_Finding):
    """The geometry does not determine c, x0, y0 of a camera, which kept their values."""

    code: Literal["interior_undetermined"] = "interior_undetermined"
    camera: str
    # A share, because without control a relative error of c is the same relative error of all height differences.
    share: float | None
    """predicted standard error in units of c; None: the normal equations are singular"""


class InteriorFixed(_Finding):
    """The adjustment failed with free interior orientations, which were all fixed."""

    code: Literal["interior_fixed"] = "interior_fixed"
    cameras: tuple[str, ...]


class InteriorUnweighted(_Finding):
    """Weighted interior orientations without standard errors, which therefore kept their values."""

    code: Literal["interior_unweighted"] = "interior_unweighted"
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
    guessed: bool = False
    """nothing gave the value: no tag told a focal length"""


class LensContradicted(_Finding):
    """The block contradicts the radial distortion that was given and held."""

    code: Literal["lens_contradicted"] = "lens_contradicted"
    camera: str
    given: tuple[float, ...]
    fits: tuple[float, ...]
    """k1 and, where the lens has it, k2"""
    border_px: float
    """by which the other distortion moves the border of the frame, less a scale"""
    ratio: float
    """length of the change in standard errors"""


class ConstantNominal(_Finding):
    """A nominal camera constant kept its value, and its uncertainty reached the heights."""

    code: Literal["constant_nominal"] = "constant_nominal"
    camera: str
    c: float
    share: float
    """its standard error in units of c"""
    guessed: bool = False
    """no tag told a focal length"""


class InteriorDemanded(_Finding):
    """The block demanded the principal point and k3 of a nominal camera, which are otherwise kept."""

    code: Literal["interior_demanded"] = "interior_demanded"
    camera: str
    x0_px: float
    y0_px: float
    k3: float
    sigma0_px: tuple[float, float]
    """without and with them"""


class PrincipalPointMoved(_Finding):
    """The principal point left its given place by many standard errors."""

    code: Literal["principal_point_moved"] = "principal_point_moved"
    camera: str
    moved_px: float


class ImageErrorsCorrelated(_Finding):
    """The errors of neighbouring image measurements are correlated, which makes standard errors notably larger."""

    code: Literal["image_errors_correlated"] = "image_errors_correlated"
    rms_px: float
    """of a coordinate over the frame, what the unknowns absorb included: an estimate from the part that the residuals show"""
    shown_px: float | None = None
    """of a coordinate, the part that the residuals show"""
    camera_share: float
    """the part of the variance that all photographs of a camera have in common"""
    # The parameter that loses most, as an example: the loss differs between parameters, and one factor for all would mislead.
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
    # By component and not by length: standard errors in plan and height differ, so that the length would hide an error in plan.
    ratio: float
    """its largest component in predicted standard errors"""


class PositionContradicted(_Finding):
    """The position of a photograph was left out because it contradicts the block."""

    code: Literal["position_contradicted"] = "position_contradicted"
    photo: str
    difference: Vector
    ratio: float


class PositionsElsewhere(_Finding):
    """Many positions contradict the block at once."""

    code: Literal["positions_elsewhere"] = "positions_elsewhere"
    photos: int
    # Length of the median, not median of the lengths: random errors cancel, and the common displacement remains.
    distance_m: float
    """length of the median difference"""


class PositionsAlongView(_Finding):
    """Positions and control contradict each other along the viewing direction only."""

    code: Literal["positions_along_view"] = "positions_along_view"
    # Heights of another vertical datum and a wrong camera constant both displace positions along the view only.
    photos: int
    along_m: float


class OffsetAdjusted(_Finding):
    """Positions have a constant error against the other sources, which was adjusted as an unknown of its own."""

    code: Literal["offset_adjusted"] = "offset_adjusted"
    photos: tuple[str, ...]
    against: Literal["control", "others"]
    """all positions against the control, or those of these photographs against the other positions"""
    offset: tuple[float | None, float | None, float | None]
    """m in X, Y and height; None where there is none"""
    sigma: tuple[float | None, float | None, float | None]
    """against the other positions as these scatter, for what they have in common is no error of their difference"""
    tilt_deg: float
    """by which the block would be tilted without it"""
    moved_m: float
    """by which the block would lie elsewhere without it, at most"""
    heights: str | None = None
    """what tags say that the heights of the positions refer to"""
    zoom: float | None = None
    """by how many times another camera constant of these photographs would explain it, too; None: it would not"""


class ConstantOfItsOwn(_Finding):
    """Photographs were taken with another camera constant than the others of their camera, and got a camera of their own."""

    code: Literal["constant_of_its_own"] = "constant_of_its_own"
    photos: tuple[str, ...]
    camera: str
    """which all of them were thought to have"""
    c_px: float
    others_px: float
    """the adjusted camera constants of these photographs and of the others"""


class UnitContradicted(_Finding):
    """The control fits the other sources in another unit of length than metres."""

    code: Literal["unit_contradicted"] = "unit_contradicted"
    unit: Literal["feet", "metres"]
    """what its coordinates are in; `metres`: they were taken for feet"""
    heights_only: bool
    given_m: float
    """misfit in height as given"""
    fits_m: float
    """misfit in height in that unit"""
    crs: str = ""
    """the system in which the control was read"""
    heights_m: tuple[float, float] | None = None
    """median height of the control as given and in that unit"""


class SourcesDisagree(_Finding):
    """A source contradicts all others in a parameter of the block, and no cause explains it."""

    code: Literal["sources_disagree"] = "sources_disagree"
    source: str
    parameter: str
    unit: str
    value: float
    sigma: float
    others: float
    others_sigma: float


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


# Without redundancy the residual of the only distance is zero whatever its error, so that no test can report a blunder.
class DistanceUnchecked(_Finding):
    """One distance alone gives the scale."""

    code: Literal["distance_unchecked"] = "distance_unchecked"


class Misfit(BaseModel):
    """A measurement in a photograph that does not fit; `misfit_px`: how far it is off (None: by more than the frame is wide);
    `lies_on`: the control point on which it lies instead."""

    model_config = ConfigDict(frozen=True)

    photo: str
    misfit_px: float | None
    # Confusing two points is a frequent blunder of manual measurement; naming the other one tells the user where to correct it.
    lies_on: str | None = None


class MeasurementsRejected(_Finding):
    """Individual image measurements of a surveyed point were rejected."""

    code: Literal["measurements_rejected"] = "measurements_rejected"
    role: Literal["control", "tie"]
    point: str
    measured: int
    rejected: tuple[Misfit, ...]


# A class of its own: check points take no part in the adjustment, so that nothing of them can be rejected there.
class CheckMeasurementsApart(_Finding):
    """Individual image measurements of a check point disagree with the others, which agree with its coordinates."""

    code: Literal["check_measurements_apart"] = "check_measurements_apart"
    point: str
    measured: int
    apart: tuple[Misfit, ...]


class GroupsUnconnected(_Finding):
    """No tie points connect these groups of photographs; each has a datum of its own. The largest comes first."""

    code: Literal["groups_unconnected"] = "groups_unconnected"
    # The largest comes first, because it is the one that the others have to be connected to.
    groups: tuple[tuple[str, ...], ...]


class BlockSeparate(_Finding):
    """Photographs that form a free block of their own."""

    code: Literal["block_separate"] = "block_separate"
    photos: tuple[str, ...]


class LargestReconstruction(_Finding):
    """Of several reconstructions in a file the largest was read."""

    code: Literal["largest_reconstruction"] = "largest_reconstruction"
    # OpenSfM writes one reconstruction per connected part, each in a system of its own: they cannot be read as one block.
    count: int
    photos: int


class PhotosUnknown(_Finding):
    """The block that was read contains photographs which the project does not have."""

    code: Literal["photos_unknown"] = "photos_unknown"
    photos: tuple[str, ...]


class BlockElsewhere(_Finding):
    """A fixed block disagrees with the positions of its photographs."""

    code: Literal["block_elsewhere"] = "block_elsewhere"
    source: str
    # A vector: its direction shows whether heights, one axis or the whole reference system differ.
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
    """A fixed block that no tie points check."""

    code: Literal["block_unexamined"] = "block_unexamined"
    source: str


BlockFinding = Annotated[
    NoDatum
    | DatumGivenUp
    | PositionsCrowded
    | ControlUnmet
    | TiltUnobserved
    | ControlOnALine
    | DatumMisfit
    | BlockBent
    | LooksUpward
    | AxesExchanged
    | DistortionFolds
    | InteriorUndetermined
    | InteriorFixed
    | InteriorUnweighted
    | ConstantContradicted
    | LensContradicted
    | ConstantNominal
    | InteriorDemanded
    | PrincipalPointMoved
    | ImageErrorsCorrelated
    | ControlContradicted
    | PositionContradicted
    | PositionsElsewhere
    | PositionsAlongView
    | OffsetAdjusted
    | ConstantOfItsOwn
    | UnitContradicted
    | SourcesDisagree
    | DistanceContradicted
    | DistanceUnchecked
    | MeasurementsRejected
    | CheckMeasurementsApart
    | GroupsUnconnected
    | BlockSeparate
    | LargestReconstruction
    | PhotosUnknown
    | BlockElsewhere
    | TiePointsMisfit
    | BlockUnexamined,
    Field(discriminator="code"),
]
