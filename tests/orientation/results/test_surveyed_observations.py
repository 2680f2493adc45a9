"""Control with blunders, positions of another place, a lever arm, distances: found, used, and named."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from orienting import orient, sentences, standardised_lengths, standardised_orientation
from simulated_block import one_strip, two_strips

from orthomill.schemas.observations import Control, Distance
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior

FIXED = FixedInterior(kind="fixed")


def with_control(block, change, distances=()):
    """The block with control points changed by `change(number among the control points, point)`."""
    control = [p for p in block.control.points if p.role == "control"]
    points = tuple(change(control.index(p), p) if p in control else p for p in block.control.points)
    return replace(block, control=Control(points=points, distances=distances))


def with_positions(block, change):
    photos = tuple(
        p.model_copy(update={"position": tuple(np.array(p.position) + change(i))}) for i, p in enumerate(block.photos.photos)
    )
    return replace(block, photos=Photos(photos=photos))


def with_blunder(block, name, error):
    return with_control(block, lambda i, p: p.model_copy(update={"xyz": tuple(np.array(p.xyz) + error)}) if p.name == name else p)


@cache
def without_blunder():
    block = two_strips(11)
    return block, orient(block)["ground_residuals"]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "axis"), [(2, 0), (2, 2), (4, 1), (5, 2)])
def test_a_blunder_in_control_is_named_as_soon_as_reliability_lets_it_be(number, axis):
    """The block tells how well a coordinate is checked: its residual has the standard error s_v, the coordinate s, and an error
    shows in the test as error * s_v / s^2. At 10 of these it must be named (the limit of the test is 4 for one number, about 5 for
    three); at 2 nothing may be, for good points have as much."""
    block, undisturbed = without_blunder()
    point = [p for p in block.control.points if p.role == "control"][number]
    row = next(p for p in undisturbed.points if p.name == point.name)
    unit = np.eye(3)[axis] * point.sigma[axis] ** 2 / row.predicted[axis]
    assert 0.02 < unit.sum() < 0.4
    found = orient(with_blunder(block, point.name, 10 * unit))
    assert found["precision"].blunders == (point.name,)
    assert np.abs(standardised_orientation(block, found["block"])).max() < 4.5
    assert orient(with_blunder(block, point.name, 2 * unit))["precision"].blunders == ()


@pytest.mark.parametrize("error", [(0, 40, 0), (3000.0, -500, 0), (3949896.0, -3949940.0, 0)])
def test_a_gross_blunder_in_control_is_found_and_named(error):
    block = two_strips(11)
    name = [p.name for p in block.control.points if p.role == "control"][2]
    out = orient(with_blunder(block, name, error))
    assert out["precision"].blunders == (name,)
    assert any(name in text and "contradicts the block" in text for text in sentences(out["precision"]))
    row = next(p for p in out["ground_residuals"].points if p.name == name)
    assert np.abs((np.array(row.difference) + error) / row.predicted).max() < 4.5
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5
    assert out["precision"].control_factor == 1.0


def test_two_swapped_control_points_are_both_found():
    block = two_strips(12)
    control = [p for p in block.control.points if p.role == "control"]
    swapped = with_control(block, lambda i, p: p.model_copy(update={"xyz": control[1 - i].xyz}) if i < 2 else p)
    out = orient(swapped)
    assert set(out["precision"].blunders) == {control[0].name, control[1].name}
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_a_wrong_measurement_of_a_control_point_is_not_blamed_on_its_coordinates():
    block = two_strips(13)
    point = next(p for p in block.control.points if p.role == "control" and len(p.measurements) >= 4)
    backwards = dict(reversed(point.measurements.items()))
    point = point.model_copy(update={"measurements": backwards})
    block = with_control(block, lambda i, p: point if p.name == point.name else p)
    photo = next(iter(point.measurements))
    col, row, sigma = point.measurements[photo]
    wrong = with_control(
        block,
        lambda i, p: p.model_copy(update={"measurements": {**p.measurements, photo: (col + 15, row, sigma)}}) if p == point else p,
    )
    out = orient(wrong)
    assert out["precision"].blunders == ()
    image, number = out["image_residuals"], -1 - [p.name for p in block.control.points].index(point.name)
    own = image.take(image.track == number)
    assert (own.used == (own.photo != block.photos.names.index(photo))).all()
    (text,) = [text for text in sentences(out["precision"]) if "measurements of the control point" in text]
    assert f"1 of {len(point.measurements)} measurements of the control point {point.name}" in text and photo in text


@pytest.mark.slow
def test_good_control_stays():
    for seed in range(3):
        assert orient(two_strips(20 + seed))["precision"].blunders == ()


def test_one_position_of_another_place_is_named_and_the_block_stands():
    block = with_positions(two_strips(14), lambda i: (12000.0, 0, 0) if i == 2 else (0, 0, 0))
    out = orient(block)
    assert len(out["block"].photos) == 6
    assert out["precision"].blunders == (block.photos.names[2],)
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_positions_of_another_place_lose_against_control():
    block = with_positions(two_strips(15), lambda i: (50000.0, -20000.0, 300.0))
    out = orient(block)
    assert set(out["precision"].blunders) == set(block.photos.names)
    assert any("53.9 km" in text and "another CRS" in text for text in sentences(out["precision"]))
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_a_small_error_of_one_position_is_found():
    block = with_positions(two_strips(16, control=0), lambda i: (0, 0, 3.0) if i == 4 else (0, 0, 0))
    out = orient(block)
    assert out["precision"].blunders == (block.photos.names[4],)


def antennas(block, lever):
    """The block with positions of an antenna at `lever` (3,) m in the image system."""
    return with_positions(block, lambda i: block.views[i].rotation.T @ np.array(lever))


def test_a_known_lever_arm_is_taken_off():
    block = antennas(two_strips(17, control=0), (2.0, -1.0, 3.0))
    out = orient(block, lever_arm=(2.0, -1.0, 3.0))
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5
    assert out["precision"].lever_arm == (2.0, -1.0, 3.0) and out["precision"].lever_arm_sigma is None
    height = [photo.centre[2] - v.centre[2] for photo, v in zip(orient(block)["block"].photos, block.views, strict=True)]
    assert np.mean(height) > 2.5


def test_a_rough_lever_arm_is_adjusted():
    block = antennas(two_strips(18), (2.0, -1.0, 3.0))
    out = orient(block, lever_arm=(1.5, -1.5, 2.5), lever_sigma=0.5)
    error = (np.array(out["precision"].lever_arm) - (2.0, -1.0, 3.0)) / out["precision"].lever_arm_sigma
    assert np.abs(error).max() < 4 and max(out["precision"].lever_arm_sigma) < 0.3
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_each_of_two_drones_has_a_lever_arm_of_its_own():
    levers = np.array([(0.3, -0.2, 0.4), (-0.1, 0.2, -0.3)])
    block = two_strips(19, gnss=0.02)
    block = with_positions(block, lambda i: block.views[i].rotation.T @ levers[i // 3])
    photos = tuple(photo.model_copy(update={"serial": f"no{i // 3}"}) for i, photo in enumerate(block.photos.photos))
    out = orient(replace(block, photos=Photos(photos=photos)), lever_sigma=0.5)
    arms = out["precision"].lever_arms
    assert [arm.receiver for arm in arms] == ["no0", "no1"] and out["precision"].lever_arm is None
    errors = [(np.array(arm.value) - lever) / arm.sigma for arm, lever in zip(arms, levers, strict=True)]
    assert np.abs(errors).max() < 4 and max(max(arm.sigma) for arm in arms) < 0.3


def test_two_drones_whose_cameras_are_known_from_tags_make_a_block_without_control():
    block = one_strip(4)
    photos = tuple(photo.model_copy(update={"serial": f"no{i // 3}"}) for i, photo in enumerate(block.photos.photos))
    out = orient(replace(block, photos=Photos(photos=photos)))
    assert len(out["block"].photos) == len(photos)


def ends_of(block):
    """The control points farthest apart and the distance between their true places (0.02 m noise on each)."""
    points = [p for p in block.control.points if p.role == "control"]
    pairs = [(np.linalg.norm(np.subtract(a.xyz, b.xyz)), a, b) for i, a in enumerate(points) for b in points[:i]]
    return max(pairs, key=lambda pair: pair[0])


def test_a_distance_gives_a_free_network_its_scale():
    block = two_strips(19, np.zeros(8), gnss=None)
    length, first, second = ends_of(block)
    free = with_control(
        block,
        lambda i, p: p.model_copy(update={"role": "tie", "xyz": (0.0, 0.0, 0.0)}),
        (Distance(first=first.name, second=second.name, length=length, sigma=0.03),),
    )
    out = orient(free, interior=FIXED)
    result = out["block"]
    assert result.datum.startswith("Free network") and "1 measured distance gives" in result.datum
    assert np.abs(standardised_lengths(block, result)).max() < 4
    (row,) = out["ground_residuals"].distances
    assert abs(row.difference) < 0.03 and row.redundancy == pytest.approx(0.0, abs=1e-6), "nothing checks the only scale"


def test_a_distance_takes_part_along_with_control():
    block = two_strips(21)
    length, first, second = ends_of(block)
    out = orient(with_control(block, lambda i, p: p, (Distance(first=first.name, second=second.name, length=length, sigma=0.02),)))
    row = out["ground_residuals"].distances[0]
    assert abs(row.difference) < 4 * row.predicted
    assert row.sigma == pytest.approx(0.02) and 0 < row.redundancy < 1
    assert next(g for g in out["precision"].groups if g.name == "distances").count == 1
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_a_distance_to_a_check_point_is_compared_and_moves_nothing():
    block = two_strips(21)
    control, check = ([p for p in block.control.points if p.role == role] for role in ("control", "check"))
    plain = orient(block)
    for first, second in ((control[0], check[0]), (check[0], check[1])):
        length = float(np.linalg.norm(np.subtract(first.xyz, second.xyz)))
        wrong = Distance(first=first.name, second=second.name, length=length + 10.0, sigma=0.02)
        out = orient(with_control(block, lambda i, p: p, (wrong,)))
        (row,) = out["ground_residuals"].distances
        assert row.role == "check" and row.difference == pytest.approx(-10.0, abs=4 * row.predicted)
        assert out["block"] == plain["block"]
        assert any("The distance from" in text and "as one to a check point" in text for text in sentences(out["precision"]))


def test_groups_share_the_redundancy(volos_like):
    out = volos_like[1]
    groups = out["precision"].groups
    assert {g.name for g in groups} == {
        "tie points in photographs",
        "surveyed points in photographs",
        "GNSS positions",
        "surveyed coordinates",
    }
    total = sum(g.redundancy for g in groups)
    assert total == pytest.approx(out["block"].redundancy, rel=0.01)


def test_the_worst_residuals_are_named_with_their_reliability(volos_like):
    block, out = volos_like
    worst = out["precision"].largest
    assert len(worst) == 12 and abs(worst[0].standardised) == max(abs(row.standardised) for row in worst)
    assert all(row.photo in block.photos.names and 0 < row.redundancy_number <= 1 for row in worst)
    assert all(row.detectable_px > 4.13 * 0.25 for row in worst)


def test_a_strip_keeps_its_tilt_with_a_wrong_position():
    block = with_positions(one_strip(3), lambda i: (0, 0, 400.0) if i == 3 else (0, 0, 0))
    out = orient(block)
    assert block.photos.names[3] in out["precision"].blunders
    assert len(out["block"].photos) == 8


def test_a_wrong_distance_along_with_control_is_named_and_blames_no_control():
    block = two_strips(21)
    length, first, second = ends_of(block)
    wrong = Distance(first=first.name, second=second.name, length=length + 1.0, sigma=0.02)
    out = orient(with_control(block, lambda i, p: p, (wrong,)))
    assert out["precision"].blunders == (f"{first.name} - {second.name}",)
    assert any("The distance from" in text and "took no part" in text for text in sentences(out["precision"]))
    row = out["ground_residuals"].distances[0]
    assert row.difference == pytest.approx(-1.0, abs=4 * row.predicted)
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_of_many_distances_in_a_free_network_the_wrong_one_is_named():
    block = two_strips(23, gnss=None)
    points = [p for p in block.control.points if p.role == "control"]
    distances = [
        Distance(first=a.name, second=b.name, length=float(np.linalg.norm(np.subtract(a.xyz, b.xyz))), sigma=0.03)
        for a, b in pairwise(points)
    ]
    distances[2] = distances[2].model_copy(update={"length": distances[2].length * 1.05})
    out = orient(
        with_control(block, lambda i, p: p.model_copy(update={"role": "tie", "xyz": (0.0, 0.0, 0.0)}), tuple(distances)),
        interior=FIXED,
    )
    assert out["precision"].blunders == (f"{distances[2].first} - {distances[2].second}",)


def test_several_blunders_of_different_kinds_are_all_named_and_no_other():
    """Swapped axes, a wrong height, and one wrong pointing, without positions to help."""
    block = two_strips(24, gnss=None)
    names = [p.name for p in block.control.points if p.role == "control"]

    def spoilt(i, p):
        if i == 0:
            return p.model_copy(update={"xyz": (p.xyz[1], p.xyz[0], p.xyz[2])})
        if i == 7:
            return p.model_copy(update={"xyz": (p.xyz[0], p.xyz[1], p.xyz[2] + 8.0)})
        if i == 3:
            photo, (col, row, sigma) = next(iter(p.measurements.items()))
            return p.model_copy(update={"measurements": {**p.measurements, photo: (col + 60, row + 30, sigma)}})
        return p

    out = orient(with_control(block, spoilt))
    assert set(out["precision"].blunders) == {names[0], names[7]}
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def as_ties(block, *distances):
    """The block whose control points are only measured in photographs, with distances between them and nothing else."""
    return with_control(block, lambda i, p: p.model_copy(update={"role": "tie", "xyz": (0.0, 0.0, 0.0)}), distances)


def chained(block, count, change):
    """`count` distances from one control point to the next, their lengths changed by `change(number, length)`."""
    points = [p for p in block.control.points if p.role == "control"][: count + 1]
    lengths = [float(np.linalg.norm(np.subtract(a.xyz, b.xyz))) for a, b in pairwise(points)]
    return [
        Distance(first=a.name, second=b.name, length=change(i, lengths[i]), sigma=0.03) for i, (a, b) in enumerate(pairwise(points))
    ]


def test_a_distance_in_feet_among_others_is_named_and_the_scale_stays():
    block = two_strips(31, np.zeros(8), gnss=None)
    distances = chained(block, 5, lambda i, length: length * (3.2808 if i == 1 else 1.0))
    out = orient(as_ties(block, *distances), interior=FIXED)
    assert out["precision"].blunders == (f"{distances[1].first} - {distances[1].second}",)
    assert np.abs(standardised_lengths(block, out["block"])).max() < 4.5


def test_two_distances_that_disagree_are_both_reported_and_the_block_is_oriented():
    block = two_strips(32, np.zeros(8), gnss=None)
    distances = chained(block, 2, lambda i, length: length * (1.03 if i else 1.0))
    out = orient(as_ties(block, *distances), interior=FIXED)
    assert len(out["block"].photos) == 6 and out["precision"].blunders == ()
    assert sum("contradicts the other distances" in text for text in sentences(out["precision"])) == 2


def test_one_distance_is_no_contradiction_but_is_not_checked():
    block = two_strips(33, np.zeros(8), gnss=None)
    out = orient(as_ties(block, *chained(block, 1, lambda i, length: length)), interior=FIXED)
    said = [text for text in sentences(out["precision"]) if "istance" in text]
    assert len(said) == 1 and said[0].startswith("One distance alone gives the scale")


@pytest.mark.parametrize("gnss", [0.1, None])
def test_measurements_under_exchanged_names_are_named_and_the_others_of_these_points_stay(gnss):
    block = two_strips(34, np.zeros(8), gnss=gnss)
    control = [point for point in block.control.points if point.role == "control"]
    pairs = ((a, b) for a in control for b in control if a.name < b.name)
    a, b, photo = next((a, b, photo) for a, b in pairs for photo in a.measurements if photo in b.measurements)

    def exchanged(i, point):
        other = {a.name: b, b.name: a}.get(point.name)
        own = {**point.measurements, **({photo: other.measurements[photo]} if other else {})}
        return point.model_copy(update={"measurements": own})

    out = orient(with_control(block, exchanged), interior=FIXED)
    for point, other in ((a, b), (b, a)):
        (said,) = [text for text in sentences(out["precision"]) if f"control point {point.name} in photographs" in text]
        assert f"{photo} (" in said and f"where {other.name} lies" in said
    assert {a.name, b.name} <= {row.name for row in out["ground_residuals"].of_role("control")}
    assert np.abs(standardised_orientation(block, out["block"])).max() < 5


def test_control_with_x_and_y_exchanged_turns_no_block_upside_down():
    """Without positions nothing tells the site; but a mirrored ground would be seen from below."""
    block = two_strips(35, np.zeros(8), gnss=None)
    out = orient(with_control(block, lambda i, p: p.model_copy(update={"xyz": (p.xyz[1], p.xyz[0], p.xyz[2])})), interior=FIXED)
    assert any("Exchange X and Y in the file" in text for text in sentences(out["precision"]))
    assert out["block"].datum.startswith("Free network") and len(out["block"].photos) == 6


def test_all_control_half_a_metre_off_is_a_contradiction_of_the_check_points():
    block = two_strips(15)
    checks = [p for p in block.control.points if p.role == "check"]
    good = orient(block)["ground_residuals"].checked
    assert good.coordinates == 3 * len(checks) and good.chance > 0.001
    moved = with_control(block, lambda i, p: p.model_copy(update={"xyz": (p.xyz[0] + 0.5, *p.xyz[1:])}))
    assert orient(moved)["ground_residuals"].checked.chance < 1e-6


def test_a_check_point_that_is_marked_once_has_no_part_in_the_joint_test():
    block = two_strips(15)
    first = next(p for p in block.control.points if p.role == "check")
    once = first.model_copy(update={"measurements": dict(list(first.measurements.items())[:1])})
    points = tuple(once if p is first else p for p in block.control.points)
    ground = orient(replace(block, control=Control(points=points)))["ground_residuals"]
    assert first.name not in {row.name for row in ground.of_role("check")}
    assert ground.checked.coordinates == 3 * len(ground.of_role("check")) and 0.001 < ground.checked.chance < 1.0
