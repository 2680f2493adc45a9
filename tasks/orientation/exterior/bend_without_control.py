"""A block that bends although control holds it: the same photographs are oriented without the control, which shows whether it is
the control that bends them."""

from collections.abc import Callable

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.datum_findings import BlockBent
from orthomill.schemas.observations import Control
from orthomill.tasks.orientation.results.block_tables import BlockTables

ENOUGH = 3
"""Control points that determine a camera constant, and so may bend a block"""


def bend_without_control(tables: BlockTables, control: Control, without: Callable[[], BlockTables]) -> BlockTables:
    """The tables whose finding of a bend says how far the block bends `without` its control; unchanged where nothing bends, where
    control cannot be the cause, or where there is no block without it."""
    bent = next((finding for finding in tables.precision.findings if isinstance(finding, BlockBent) and finding.grave), None)
    if bent is None or sum(point.role == "control" for point in control.points) < ENOUGH:
        return tables
    try:
        others = without().precision.findings
    except GeometryError:
        return tables
    alone = next((abs(finding.bend_m) for finding in others if isinstance(finding, BlockBent)), 0.0)
    told = bent.model_copy(update={"without_control_m": alone})
    findings = tuple(told if finding is bent else finding for finding in tables.precision.findings)
    return tables._replace(precision=tables.precision.model_copy(update={"findings": findings}))
