"""All findings of the block orientation, as tables hold them: the code tells which one it is."""

from typing import Annotated

from pydantic import Field

from orthomill.schemas.findings.camera_findings import (
    ConstantContradicted,
    ConstantNominal,
    DistortionFolds,
    ImageErrorsCorrelated,
    InteriorDemanded,
    InteriorFixed,
    InteriorUndetermined,
    InteriorUnweighted,
    LensContradicted,
    PrincipalPointMoved,
)
from orthomill.schemas.findings.contradiction_findings import (
    ConstantOfItsOwn,
    OffsetAdjusted,
    PositionsDrift,
    ScaleContradicted,
    SourcesDisagree,
    UnitContradicted,
)
from orthomill.schemas.findings.datum_findings import (
    AxesExchanged,
    BlockBent,
    BlockSeparate,
    ControlOnALine,
    DatumGivenUp,
    DatumMisfit,
    GroupsUnconnected,
    LooksUpward,
    NoDatum,
    PointsExchanged,
    PositionsCrowded,
    TiltUnobserved,
)
from orthomill.schemas.findings.foreign_findings import (
    BlockElsewhere,
    BlockUnexamined,
    LargestReconstruction,
    PhotosUnknown,
    TiePointsMisfit,
)
from orthomill.schemas.findings.observation_findings import (
    CheckMeasurementsApart,
    ControlContradicted,
    ControlUnmet,
    DistanceContradicted,
    DistanceUnchecked,
    MarksInAnotherFrame,
    MeasurementsRejected,
    PositionContradicted,
    PositionsAlongView,
    PositionsElsewhere,
)

BlockFinding = Annotated[
    NoDatum
    | DatumGivenUp
    | PositionsCrowded
    | ControlUnmet
    | MarksInAnotherFrame
    | TiltUnobserved
    | ControlOnALine
    | DatumMisfit
    | BlockBent
    | LooksUpward
    | AxesExchanged
    | PointsExchanged
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
    | PositionsDrift
    | ConstantOfItsOwn
    | UnitContradicted
    | ScaleContradicted
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
