"""Photographs with a camera constant of their own: which ones are tried, and with which constant."""

from orthomill.schemas.findings.contradiction_findings import ConstantOfItsOwn
from orthomill.tasks.orientation.block.own_constants import OwnConstant, apart, refined

SHOWN, OTHERS = ("c", "d"), ("a", "b")


def test_positions_tell_the_constant_of_photographs_that_show_the_ground_larger():
    assert refined((OwnConstant(SHOWN, 1.54),), (OwnConstant(SHOWN, 1.497),)) == (OwnConstant(SHOWN, 1.497),)


def test_most_of_the_photographs_are_enough():
    assert refined((OwnConstant(("b", "c", "d"), 2.05),), (OwnConstant(SHOWN, 2.0),)) == (OwnConstant(("b", "c", "d"), 2.0),)


def test_positions_that_say_something_else_are_not_believed():
    assert refined((OwnConstant(SHOWN, 1.54),), (OwnConstant(SHOWN, 1.2),)) == (OwnConstant(SHOWN, 1.54),)


def test_each_group_of_photographs_is_tried_once_and_those_that_are_shown_come_first():
    by_positions = (OwnConstant(OTHERS, 1.1), OwnConstant(SHOWN, 1.5))
    assert refined((OwnConstant(SHOWN, 1.52),), by_positions) == (OwnConstant(SHOWN, 1.5), OwnConstant(OTHERS, 1.1))
    assert refined((), by_positions) == by_positions and refined((OwnConstant(SHOWN, 1.3),), ()) == (OwnConstant(SHOWN, 1.3),)


def test_constants_that_come_out_alike_are_of_one_camera():
    found = ConstantOfItsOwn(photos=SHOWN, camera="cam", c_px=1069.0, others_px=1067.5)
    assert not apart((found,)) and apart((found.model_copy(update={"c_px": 1120.0}),))
