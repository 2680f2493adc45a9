"""Warnings appear where something is poorly determined, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from orthomill.schemas.findings.camera_findings import InteriorFixed
from orthomill.schemas.findings.control_findings import HeightsAllZero
from orthomill.schemas.findings.datum_findings import DatumMisfit, NoDatum
from orthomill.schemas.findings.observation_findings import ControlContradicted, DistanceUnchecked
from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import GroundResiduals, ObservationGroup, ParameterCorrelation, Unoriented
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.testing.adjustment_result import ObservationKind
from orthomill.tasks.orientation.report.block_doubts import block_doubts
from orthomill.tasks.orientation.report.block_figures import block_figures
from orthomill.tasks.orientation.report.block_warnings import block_warnings


def told(facts):
    return " ".join(block_warnings(facts))


def with_control(facts, points, rows=None):
    compared = facts.ground.points if rows is None else rows
    return replace(facts, control=Control(points=tuple(points)), ground=GroundResiduals(points=tuple(compared)))


def with_differences(facts, differences):
    """The facts in which the named points differ from the block by so many of their predicted standard errors."""
    rows = (
        row.model_copy(update={"difference": (0.1 * differences[row.name], 0.0, 0.0)}) if row.name in differences else row
        for row in facts.ground.points
    )
    return with_control(facts, facts.control.points, rows)


def test_a_sound_block_has_no_warnings(facts):
    assert list(block_warnings(facts)) == []


def test_findings_are_spoken_and_reasons_of_photographs_repeated(with_block, with_precision):
    assert "c has no tie points." in told(with_block(unoriented=(Unoriented(photo="c", reason="c has no tie points."),)))
    found = told(with_precision(findings=(DistanceUnchecked(), ControlContradicted(point="P7", difference=(1, 2, 3), ratio=9.0))))
    assert "One distance alone" in found and "The control point P7 contradicts" in found


def test_missing_control_and_missing_checks_are_different_warnings(facts):
    assert "There is no ground control" in told(with_control(facts, (), ()))
    control = [point for point in facts.control.points if point.role == "control"]
    found = told(with_control(facts, control))
    assert "There are no check points" in found and "There is no ground control" not in found


def test_positions_are_spoken_of_only_where_there_are_any(facts):
    bare = with_control(facts, (), ())
    assert "no photograph has a position" in told(bare) and "as good as the positions" not in told(bare)
    first, second = facts.photos.photos
    placed = facts.photos.model_copy(update={"photos": (first.model_copy(update={"position": (0.0, 0.0, 100.0)}), second)})
    assert "as good as the positions" in told(replace(bare, photos=placed))


def test_tie_points_that_a_person_measured_are_no_control(facts):
    ties = [point.model_copy(update={"role": "tie"}) for point in facts.control.points]
    assert "There is no ground control" in told(with_control(facts, ties, ()))


def test_a_block_without_a_place_compares_no_point(facts):
    found = list(block_warnings(with_control(facts, facts.control.points, ())))
    assert found == ["None of the 5 surveyed points was compared with the block, which has no place in their system."]


@pytest.mark.parametrize("photos", [0, None])
def test_a_point_that_took_no_part_is_named(facts, photos):
    rows = [row for row in facts.ground.points if row.name != "C2"]
    if photos is not None:
        rows.append(next(row for row in facts.ground.points if row.name == "C2").model_copy(update={"photos": photos}))
    found = list(block_warnings(with_control(facts, facts.control.points, rows)))
    assert len(found) == 1 and found[0].startswith("The control point C2 took no part")


def test_one_doubtful_point_is_named_alone_and_several_together(facts):
    assert "The control point C1 differs from the block" in told(with_differences(facts, {"C1": 4.1}))
    several = told(with_differences(facts, {"C1": 4.1, "K1": -5.0}))
    assert "Several points differ" in several and "control point C1, check point K1" in several


def test_a_point_within_four_standard_errors_is_not_doubtful(facts):
    assert told(with_differences(facts, {"C1": 3.9, "K1": -3.9})) == ""


def test_a_blunder_is_not_reported_again_as_doubtful(facts):
    facts = with_differences(facts, {"C1": 40.0})
    assert "C1" not in told(replace(facts, precision=facts.precision.model_copy(update={"blunders": ("C1",)})))


@pytest.mark.parametrize(
    ("east", "north", "side"), [(1, 1, "north-east"), (-1, 1, "north-west"), (1, -1, "south-east"), (-1, -1, "south-west")]
)
def test_one_sided_control_names_its_side(facts, east, north, side):
    places = {"C0": (0, 0), "C1": (5, 0), "C2": (5, 5), "C3": (0, 5)}
    moved = [
        point.model_copy(update={"xyz": (10 + east * (35 + places[point.name][0]), north * (35 + places[point.name][1]), 0.0)})
        if point.name in places
        else point
        for point in facts.control.points
    ]
    found = told(with_control(facts, moved))
    assert "one-sided" in found and f"towards the {side}" in found


def correlation(first, second, value=0.95):
    return ParameterCorrelation(first=first, second=second, value=value)


def test_correlated_parameters_of_a_camera_are_one_warning(with_precision):
    pairs = (correlation("x0 of cam", "p1 of cam", 0.97), correlation("y0 of cam", "p2 of cam", -0.94))
    (found,) = block_warnings(with_precision(correlations=pairs))
    assert "x0 and p1 (0.97), y0 and p2 (-0.94)" in found


def test_a_correlation_with_the_flying_height_says_what_separates_them(with_precision):
    (found,) = block_warnings(with_precision(correlations=(correlation("c of cam", "the mean height of the projection centres"),)))
    assert "correlation 0.95" in found and "Control at different heights" in found


def test_a_block_without_datum_has_no_flying_height(with_precision):
    pair = correlation("y0 of cam", "the mean height of the projection centres")
    assert "distinguished" not in told(with_precision(correlations=(pair,), findings=(NoDatum(scaled=False),)))


def test_a_correlation_between_cameras_gives_no_advice_on_heights(with_precision):
    (found,) = block_warnings(with_precision(correlations=(correlation("c of one", "c of other"),)))
    assert "heights" not in found


def test_parameters_that_many_cameras_share_are_one_sentence(with_precision):
    names = "abcd"
    pairs = tuple(correlation(f"c of {one}", f"c of {other}") for k, one in enumerate(names) for other in names[k + 1 :])
    (found,) = block_warnings(with_precision(correlations=pairs))
    assert found.startswith("c of 4 cameras can hardly be distinguished from each other") and "in 6 pairs" in found
    assert found.endswith("They are a, b, c, d.")


def test_a_camera_from_exif_that_was_not_adjusted_is_named(facts):
    nominal = facts.before.cameras["cam"].model_copy(update={"source": "exif"})
    before = facts.before.model_copy(update={"cameras": {"cam": nominal}})
    assert "The camera cam is known from EXIF only" in told(replace(facts, before=before))


@pytest.mark.parametrize(("c", "warned"), [(1070.0, True), (930.0, True), (1050.0, False)])
def test_a_camera_constant_that_changed_much_is_named(facts, with_block, c, warned):
    camera = facts.block.cameras["cam"].model_copy(update={"source": "block", "c": c})
    assert ("far from the ones that were given: cam (" in told(with_block(cameras={"cam": camera}))) == warned


@pytest.mark.parametrize(("sigma", "warned"), [(5.0, False), (20.0, True)])
def test_a_constant_from_exif_may_be_off_where_the_block_determines_it(facts, sigma, warned):
    """Of 1100 px; both photographs of one sensor are one camera."""
    cov = np.zeros((17, 17))
    cov[0, 0] = sigma**2
    given = facts.before.cameras["cam"].model_copy(update={"source": "exif"})
    camera = given.model_copy(update={"source": "block", "c": 1100.0, "covariance": tuple(map(tuple, cov.tolist()))})
    turned = {name: camera.model_copy(update={"name": name}) for name in ("cam", "cam turned 6")}
    block = facts.block.model_copy(update={"cameras": turned, "of_photo": {"a": "cam", "b": "cam turned 6"}})
    before = facts.before.model_copy(update={"cameras": dict.fromkeys(turned, given)})
    said = [text for text in block_warnings(replace(facts, block=block, before=before)) if "Adjusted camera constant" in text]
    assert [text.split(". ")[0].split(": ")[1] for text in said] == (["cam (+10.0 %)"] if warned else [])


def of_cameras(facts, names, c=1000.0, **changes):
    """The facts with as many cameras as `names`, from EXIF before, and changed in the block."""
    given = facts.before.cameras["cam"].model_copy(update={"source": "exif", "covariance": variance_of_c(250.0)})
    before = {name: given.model_copy(update={"name": name}) for name in names}
    after = {name: camera.model_copy(update={"c": c, **changes}) for name, camera in before.items()}
    block = facts.block.model_copy(update={"cameras": after, "of_photo": {"a": names[0], "b": names[1]}})
    return replace(facts, block=block, before=facts.before.model_copy(update={"cameras": before}))


def variance_of_c(sigma):
    cov = np.zeros((17, 17))
    cov[0, 0] = sigma**2
    return tuple(map(tuple, cov.tolist()))


def test_many_cameras_that_were_not_adjusted_are_one_sentence_and_guessed_ones_no_exif(facts, with_precision):
    held = of_cameras(facts, ("one", "two", "three"))
    (found,) = block_warnings(held)
    assert found.startswith("3 cameras are guessed, as no tag tells their constants, and were not adjusted")
    assert found.endswith("They are one, two, three.") and "EXIF" not in found
    fixed = held.precision.model_copy(update={"findings": (InteriorFixed(cameras=("one", "two", "three")),)})
    (found,) = block_warnings(replace(held, precision=fixed))
    assert found.startswith("The interior orientation of 3 cameras (one, two, three) could not be adjusted")


@pytest.mark.parametrize(("c", "warned"), [(1400.0, False), (1600.0, True)])
def test_a_guessed_constant_may_be_half_off(facts, c, warned):
    # A narrower field of view leaves less overlap, which is no matter here.
    told_of = block_warnings(of_cameras(facts, ("one", "two"), c, source="block"))
    found = [text for text in told_of if not text.startswith("Weak overlap")]
    assert [text.split(". ")[0] for text in found] == (
        ["Adjusted camera constants are far from the ones that were guessed, as no tag tells them: one (+60.0 %), two (+60.0 %)"]
        if warned
        else []
    )


def test_correlated_parameters_of_many_cameras_are_one_warning(with_precision):
    pairs = (correlation("c of one", "k1 of one", 0.97), correlation("c of two", "k1 of two"), correlation("c of two", "k2 of two"))
    (found,) = block_warnings(with_precision(correlations=pairs))
    assert "Parameters of 2 cameras" in found and "one (c and k1 0.97), two (c and k1 0.95, c and k2 0.95)" in found


def test_a_photograph_with_few_measurements_or_an_empty_frame_is_weakly_tied(facts):
    image = facts.image
    few = told(replace(facts, image=image.take((image.photo == 0) | (np.arange(len(image)) % 2 == 0))))
    assert "Weakly tied" in few and "b (18 measurements" in few and "a (" not in few
    corner = replace(image, col=np.where(image.photo == 1, image.col / 3, image.col))
    assert "b (36 measurements in 3 areas)" in told(replace(facts, image=corner))


def test_a_block_without_tie_points_has_no_weakly_tied_photographs(facts):
    assert "Weakly tied" not in told(replace(facts, image=facts.image.take(np.zeros(len(facts.image), bool))))


def test_a_block_that_is_taken_as_given_has_a_place_and_no_known_overlap(facts):
    nothing = facts.image.take(np.zeros(len(facts.image), bool)), facts.points.take(np.zeros(len(facts.points), bool))
    given = with_control(replace(facts, image=nothing[0], points=nothing[1]), (), ())
    assert "as good as that source" in told(given)
    assert "Weak overlap" not in told(given) and "no place" not in told(given)
    assert {figure.value for figure in block_figures(given) if figure.name.startswith("covered_by")} == {None}


def test_photographs_that_hardly_overlap_are_told_with_their_overlap(facts, with_block):
    first, second = facts.block.photos
    assert "Weak overlap: only 2" in told(with_block(photos=(first, second.model_copy(update={"centre": (60.0, 0.0, 100.0)}))))


@pytest.mark.parametrize(
    ("changes", "phrase"),
    [
        ({"position_factor": 3.26}, "The GNSS positions are worse than stated: their standard errors were enlarged 3.3 times"),
        ({"control_factor": 2.0}, "The ground control is worse than stated: its standard errors were enlarged 2.0 times"),
        ({"rejected": 28}, "28 % of the image measurements were rejected"),
    ],
)
def test_what_is_worse_than_stated_is_told_with_its_factor(with_precision, changes, phrase):
    (found,) = block_warnings(with_precision(**changes))
    assert phrase in found


def test_the_group_of_positions_that_is_worse_than_stated_is_named(with_precision):
    groups = [
        ObservationGroup(name=ObservationKind.POSITIONS, count=30, redundancy=20.0, factor=factor, part=part)
        for part, factor in (("drone A", 1.0), ("drone B", 24.5))
    ]
    (found,) = block_warnings(with_precision(position_factor=24.5, groups=tuple(groups)))
    assert "Some groups of GNSS positions" in found and "drone B (24.5 times)" in found and "drone A" not in found
    both = tuple(group.model_copy(update={"factor": 4.0}) for group in groups)
    (found,) = block_warnings(with_precision(position_factor=4.0, groups=both))
    assert found.startswith("The GNSS positions are worse than stated")


def test_control_without_heights_is_told_once(with_precision):
    """That it does not fit, and that it is worse than stated, are the same fact."""
    facts = with_precision(control_factor=36.1, findings=(DatumMisfit(ratio=32.0),))
    assert "disagree" in told(facts) and "worse than stated" in told(facts)
    flat = replace(facts, control=facts.control.model_copy(update={"findings": (HeightsAllZero(points=10),)}))
    (found,) = block_warnings(flat)
    assert found.startswith("All 10 surveyed points have the height 0")
    assert list(block_doubts(flat)) == [found]


@pytest.mark.parametrize(("factor", "count"), [(1.0, 0), (2.5, 1)])
def test_pointings_worse_than_stated_are_told(with_precision, factor, count):
    group = ObservationGroup(name=ObservationKind.POINTINGS, count=10, redundancy=5.0, factor=factor)
    found = list(block_warnings(with_precision(groups=(group,))))
    assert len(found) == count and all("enlarged 2.5 times" in text for text in found)


@pytest.mark.parametrize(
    ("factor", "said", "unsaid"),
    [
        (20.0, ["is worse than stated", "enlarged 20.0 times", "good to 0.4 m, not the 0.02 m stated", "Survey"], "not where"),
        (99.9, ["is worse than stated", "good to 2 m"], "not where"),
        (100.0, ["not where the block sees it", "by about 2 m, where 0.02 m are stated", "reference system"], "enlarged"),
    ],
)
def test_bad_control_is_told_with_what_it_is_good_to_and_from_factor_100_on_as_elsewhere(with_precision, factor, said, unsaid):
    (found,) = block_warnings(with_precision(control_factor=factor))
    assert all(word.lower() in found.lower() for word in said) and unsaid not in found


@pytest.mark.parametrize(
    ("factor", "said", "unsaid"),
    [
        (40.0, ["good to 20 px, not the 0.5 px stated", "enlarged 40.0 times", "more precisely"], "not where"),
        (100.0, ["not where the block sees them in the photographs", "by about 50 px", "other photographs"], "enlarged"),
    ],
)
def test_bad_marks_are_told_with_what_they_are_good_to_and_from_factor_100_on_as_of_other_points(
    with_precision, factor, said, unsaid
):
    group = ObservationGroup(name=ObservationKind.POINTINGS, count=10, redundancy=5.0, factor=factor)
    (found,) = block_warnings(with_precision(groups=(group,)))
    assert all(word in found for word in said) and unsaid not in found


@pytest.mark.parametrize(
    ("redundancy", "told_of"), [(None, True), ((0.3, 0.9, 0.9), True), ((0.29, 0.9, 0.9), False), ((0.9, 0.0, 0.0), True)]
)
def test_only_a_coordinate_that_others_check_may_be_wrong(facts, redundancy, told_of):
    first, *rest = facts.ground.points
    far = first.model_copy(update={"difference": (0.9, 0.0, 0.0), "redundancy": redundancy})
    found = told(replace(facts, ground=facts.ground.model_copy(update={"points": (far, *rest)})))
    assert ("C0 differs from the block" in found and "may be wrong" in found) is told_of


@pytest.mark.parametrize(("findings", "coordinate"), [((), True), ((NoDatum(scaled=False),), False)])
def test_coordinates_that_take_no_part_are_not_suspected(with_precision, findings, coordinate):
    group = ObservationGroup(name=ObservationKind.POINTINGS, count=10, redundancy=5.0, factor=2.5)
    (found,) = (text for text in block_warnings(with_precision(groups=(group,), findings=findings)) if "fit worse" in text)
    assert ("wrong coordinate" in found) is coordinate


def test_files_for_other_programs_warn_of_scans_and_mirrors(facts):
    first, second = facts.photos.photos
    scan = first.model_copy(update={"scan": (0.0, 1.0, 0.0, 0.0, 0.0, 1.0), "scan_size": (1100, 1100)})
    assert "The photographs are scans" in told(replace(facts, photos=Photos(photos=(scan, second))))
    mirrored = second.model_copy(update={"exif_orientation": 4})
    assert "EXIF mirrors b" in told(replace(facts, photos=Photos(photos=(first, mirrored))))


def test_a_block_without_datum_is_not_called_as_good_as_its_positions(facts):
    placed = tuple(photo.model_copy(update={"position": (1.0, 2.0, 300.0)}) for photo in facts.photos.photos)
    bare = replace(with_control(facts, (), ()), photos=Photos(photos=placed))
    assert "as good as the positions" in told(bare)
    free = replace(bare, precision=bare.precision.model_copy(update={"findings": (NoDatum(scaled=False),)}))
    assert "as good as the positions" not in told(free)
    nowhere = replace(free, photos=facts.photos)
    assert "has no datum" in told(nowhere) and "no photograph has a position" not in told(nowhere), "one sentence is enough"
