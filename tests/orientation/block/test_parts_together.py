"""Parts of a block put into one problem: photographs renumbered, points owned by one part, everything in one system."""

from dataclasses import replace

import numpy as np
import pytest

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.findings.datum_findings import ControlOnALine, NoDatum
from orthomill.schemas.observations import Control, ControlPoint, Distance
from orthomill.tasks.adjustment.model.network import Interior, Rays, State
from orthomill.tasks.orientation.block.assembly import Part, problem_of, starting_values, taking_part
from orthomill.tasks.orientation.start.block_growth import GrowthMaterial
from orthomill.tasks.orientation.start.block_start import BlockStart
from orthomill.tasks.orientation.start.georeference import Datum, Known, looks_elsewhere
from orthomill.tasks.orientation.start.similarity import Similarity

CAMERA = Camera(name="cam", width=1000, height=1000, c=1000.0)
CAMERAS = Cameras(cameras={"cam": CAMERA}, of_photo=dict.fromkeys("abcde", "cam"))
HEIGHT = 100.0


def material(seen):
    """Photographs a to e, 10 m apart, and points on the ground below; `seen`: point -> numbers of photographs."""
    point, photo = (np.array(v, np.int32) for v in zip(*((p, i) for p, own in seen.items() for i in own), strict=True))
    rays = Rays(point, photo, np.zeros((len(point), 2)), np.full(len(point), 0.5))
    free = np.zeros((1, 17), bool)
    interior = Interior(np.array([CAMERA.interior]), np.zeros((1, 17, 17)), free, free)
    return GrowthMaterial(tuple("abcde"), ("cam",), [CAMERA], np.zeros(5, np.int64), interior, rays, max(seen) + 1, ())


def part(photos, known, points, origin=(0.0, 0.0, 0.0), surveyed=0, **changes):
    """A part whose model is its true place less its origin."""
    photos, count = np.array(photos), len(photos)
    model = State(
        np.tile(np.eye(3), (count, 1, 1)),
        np.column_stack([10.0 * photos, np.zeros(count), np.full(count, HEIGHT)]) - origin,
        np.column_stack([2.0 * np.arange(points), np.zeros(points), np.zeros(points)]) - origin,
        np.array([CAMERA.interior]),
        np.zeros(3),
    )
    has = np.isin(np.arange(points), known)
    nothing, none = np.full((count, 3), np.nan), np.full((surveyed, 3), np.nan)
    given = Known(nothing, nothing, none, np.full((surveyed, 3), np.inf), none, nothing, np.tile([0.0, 1.0, 0.0], (count, 1)))
    placed = Similarity(1.0, np.eye(3), np.zeros(3))
    datum = Datum(placed, np.array(origin), False, None, "Control.", (), np.zeros(count, bool), np.zeros(surveyed, bool))
    start = BlockStart(model, photos, has, np.ones(12, bool))
    return Part(start, model, given, replace(datum, **changes))


SEEN = {0: (0, 1), 1: (0, 1), 2: (0, 1, 3, 4), 3: (3, 4), 4: (3, 4)}


def test_a_group_that_an_assumption_places_and_that_looks_elsewhere_than_the_block_has_no_place():
    block, group = part([0, 1], [0, 1, 2], 5), part([3, 4], [2, 3, 4], 5, basis="down")
    assert not looks_elsewhere(group.model, group.datum, block.model, block.datum)
    about_the_line = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    turned = replace(group.datum, similarity=Similarity(1.0, about_the_line, np.zeros(3)))
    assert looks_elsewhere(group.model, turned, block.model, block.datum)
    # What positions or attitudes place may look anywhere.
    assert not looks_elsewhere(group.model, replace(turned, basis=None), block.model, block.datum)


@pytest.fixture
def two():
    """a and b know points 0 to 2, d and e points 2 to 4; c is in no part."""
    return [part([0, 1], [0, 1, 2], 5), part([3, 4], [2, 3, 4], 5, origin=(100.0, 50.0, 0.0))]


def problem(parts, control=None):
    return problem_of(material(SEEN), parts, CAMERAS, control or Control())


def test_photographs_are_renumbered_without_those_in_no_part(two):
    found, _ = problem(two)
    assert found.names == ("a", "b", "d", "e") and found.active.tolist() == [0, 1, 3, 4]
    assert found.groups == (("a", "b"), ("d", "e"))
    assert set(found.rays.photo.tolist()) == {0, 1, 2, 3}


def test_a_point_of_two_parts_belongs_to_the_first(two):
    found, _ = problem(two)
    shared = found.rays.point == 2
    assert found.good[shared & (found.rays.photo < 2)].all()
    assert not found.good[shared & (found.rays.photo >= 2)].any()
    assert found.good[~shared].all()


def test_rays_that_the_start_rejected_stay_rejected(two):
    first, second = two
    good = np.ones(12, bool)
    good[1] = False
    first = replace(first, start=replace(first.start, good=good))
    found, _ = problem([first, second])
    assert not found.good[1] and found.good[0]


def test_rays_of_unknown_points_are_counted_but_not_used():
    found, _ = problem([part([0, 1], [0, 1], 5)])
    assert set(found.rays.point.tolist()) == {0, 1}
    assert found.measured == 6, "three points in two photographs each"


def test_all_parts_start_in_the_system_of_the_first(two):
    found, datum = problem(two)
    _, state, _ = starting_values(material(SEEN), found, two, datum, 0.1)
    assert np.allclose(state.centre[:, 0], [0, 10, 30, 40]) and np.allclose(state.centre[:, 1], 0)
    assert np.allclose(state.point[:, 0], [0, 2, 4, 6, 8])


def test_findings_of_parts_are_told_once(two):
    first, second = (
        replace(p, datum=replace(p.datum, findings=own))
        for p, own in zip(two, [(ControlOnALine(),), (NoDatum(scaled=False), ControlOnALine())], strict=True)
    )
    assert problem([first, second])[1].findings == (ControlOnALine(), NoDatum(scaled=False))


@pytest.mark.parametrize(("aside", "expected"), [((True, True), True), ((True, False), False), ((False, False), False)])
def test_a_control_point_is_set_aside_where_no_part_has_it_in_its_place(aside, expected):
    point = ControlPoint(name="P", role="control", xyz=(1.0, 2.0, 3.0), sigma=(0.1,) * 3, measurements={})
    parts = []
    for photos, known, own in (([0, 1], [0, 1, 2], aside[0]), ([3, 4], [2, 3, 4], aside[1])):
        one = part(photos, known, 5, surveyed=1, control_aside=np.array([own]))
        place = np.array([[1.0, 2.0, 3.0]])
        known_here = type(one.known)(
            **{**vars(one.known), "control": place, "control_sigma": 0 * place + 0.1, "control_model": place}
        )
        parts.append(Part(one.start, one.model, known_here, one.datum))
    assert problem(parts, Control(points=(point,)))[1].control_aside.tolist() == [expected]


def test_the_weight_of_the_mean_vertical_is_shared_by_the_photographs():
    up = np.tile([0.0, 0.0, 1.0], (2, 1))
    one = part([0, 1], [0, 1, 2], 5, up=up)
    found, datum = problem([one])
    network, _, _ = starting_values(material(SEEN), found, [one], datum, 0.1)
    assert network.vertical_weight.sum() == pytest.approx(1 / 0.1**2)
    assert np.allclose(network.up, up)


def test_no_verticality_constraint_without_an_up_direction(two):
    found, datum = problem(two)
    network, _, _ = starting_values(material(SEEN), found, two, datum, 0.1)
    assert not network.vertical_weight.any()


def surveyed(name, role, photos):
    pixels = dict.fromkeys(photos, (499.5, 499.5, 0.5))
    return ControlPoint(name=name, role=role, xyz=(0.0, 0.0, 0.0), sigma=(0.1,) * 3, measurements=pixels)


def test_check_points_and_single_measurements_take_no_part():
    points = (surveyed("C", "control", "a"), surveyed("T", "tie", "ab"), surveyed("S", "tie", "a"), surveyed("K", "check", "ab"))
    assert [point.name for point in taking_part(Control(points=points))] == ["C", "T"]


def with_distances(*pairs, lost=()):
    """The network of three points measured by a person on the ground below a and b, and distances between them; those `lost` are
    behind the cameras."""
    names = ("P", "Q", "R")
    points = tuple(surveyed(name, "tie", "ab") for name in names)
    control = Control(points=points, distances=tuple(Distance(first=a, second=b, length=4.0, sigma=0.1) for a, b in pairs))
    place = np.array([[2.0, 0.0, 2 * HEIGHT if name in lost else 0.0] for name in names])
    number = {name: i for i, name in enumerate(names)}
    lengths = tuple((number[a], number[b], 4.0, 0.1) for a, b in pairs)
    one = part([0, 1], [0, 1, 2], 5, surveyed=3)
    one = replace(one, known=replace(one.known, control_model=place, distances=lengths))
    found, datum = problem([one], control)
    return starting_values(material(SEEN), found, [one], datum, 0.1)[0]


def test_distances_keep_their_ends_among_the_unknowns():
    network = with_distances(("P", "Q"), ("Q", "R"))
    assert network.distances.ends.tolist() == [[5, 6], [6, 7]] and network.kept.tolist() == [5, 6, 7]
    assert np.allclose(network.distances.weight, 1 / 0.1**2) and network.distances.length.tolist() == [4.0, 4.0]


def test_a_distance_to_a_point_that_no_ray_determines_is_left_out():
    network = with_distances(("P", "Q"), ("Q", "R"), lost=("R",))
    assert network.distances.ends.tolist() == [[5, 6]] and network.kept.tolist() == [5, 6]


def test_without_distances_nothing_is_kept():
    assert len(with_distances().kept) == 0
