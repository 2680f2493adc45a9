"""Whether a block that bends does so without its control, too."""

import pytest

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.datum_findings import BlockBent, NoDatum
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.orientation import BlockPrecision
from orthomill.tasks.orientation.exterior.bend_without_control import bend_without_control
from orthomill.tasks.orientation.results.block_tables import BlockTables


def tables(*findings):
    return BlockTables(*[None] * len(BlockTables._fields))._replace(precision=BlockPrecision.model_construct(findings=findings))


def bent(bend, grave=True):
    return BlockBent(bend_m=bend, extent_m=80.0, pixels=abs(bend) / 0.1, scatter_m=0.1, views_deg=None, grave=grave)


def control(points):
    return Control(
        points=tuple(
            ControlPoint(name=f"P{i}", role="control", xyz=(i, 0.0, 0.0), sigma=(0.02,) * 3, measurements={}) for i in range(points)
        )
    )


@pytest.mark.parametrize(
    ("others", "alone", "by_control"), [((bent(-0.5),), 0.5, True), ((), 0.0, True), ((bent(1.6),), 1.6, False)]
)
def test_the_bend_without_control_tells_whether_that_is_the_cause(others, alone, by_control):
    found = bend_without_control(tables(NoDatum(scaled=True), bent(-1.7)), control(4), lambda: tables(*others))
    first, told = found.precision.findings
    assert isinstance(first, NoDatum) and told.without_control_m == alone and told.by_control is by_control


@pytest.mark.parametrize(("findings", "points"), [((), 4), ((bent(0.1, grave=False),), 4), ((bent(-1.7),), 2)])
def test_nothing_is_oriented_again_where_control_bends_nothing(findings, points):
    own = tables(*findings)
    assert bend_without_control(own, control(points), pytest.fail) is own


def test_photographs_that_are_no_block_without_control_keep_the_finding():
    def refused():
        raise GeometryError("no block")

    own = tables(bent(-1.7))
    assert bend_without_control(own, control(4), refused) is own
