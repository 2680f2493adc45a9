"""Geometry that does not hold: named with advice, and the rest of the block still oriented."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient, sentences, standardised_orientation
from simulated_block import DRONE, TRUE_CAMERA, calibrated, one_strip, photo_of, simulate, two_strips, view

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior, FreeInterior
from orthomill.tasks.orientation.relative.pairs import relate_pairs

FIXED = FixedInterior(kind="fixed")


def names_of(out):
    return set(out["block"].names)


def test_a_photograph_given_twice_is_left_out():
    block = two_strips(31)
    ties, n = block.tie_points, len(block.photos.photos)
    own = ties.take(ties.photo == 1)
    both = [np.concatenate([getattr(ties, f), getattr(own, f)]) for f in ("track", "col", "row", "sigma")]
    photo = np.concatenate([ties.photo, np.full(len(own), n, np.int32)])
    copy = block.photos.photos[1].model_copy(update={"name": "copy"})
    cameras = block.cameras.model_copy(update={"of_photo": block.cameras.of_photo | {"copy": "cam"}})
    doubled = replace(
        block, tie_points=type(ties)(both[0], photo, *both[1:]), photos=Photos(photos=(*block.photos.photos, copy)), cameras=cameras
    )
    out = orient(doubled)
    assert names_of(out) == {v.name for v in block.views}
    (left,) = out["block"].unoriented
    assert left.photo == "copy" and "same photograph as s0_1" in left.reason
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def turned_views(count):
    """Photographs from one place, the camera turned a little between them."""
    return [view(f"t{i}", DRONE, (407000, 4357000, 180), (3 * i, -2 * i, 90 + 5 * i)) for i in range(count)]


def test_pure_rotation_is_named():
    block = simulate(turned_views(3), DRONE, 1, gnss=None, control=0, check=0, tracks=400)
    with pytest.raises(GeometryError, match="taken from one place"):
        orient(block)


def test_a_turned_photograph_joins_a_block_that_has_a_base():
    strip = [view(f"d{i}", DRONE, (407000 + 20 * i, 4357000, 180), (0, 0, 90)) for i in range(5)]
    extra = view("turned", DRONE, (407040, 4357000, 180), (4, 3, 95))
    block = simulate([*strip, extra], DRONE, 2, gnss=1.0, control=0, check=0, tracks=900)
    out = orient(block, interior=FIXED)
    pair = next(p for p in out["relative"].pairs if {p.left, p.right} == {"d2", "turned"})
    assert "pure rotation" in pair.outcome and not pair.oriented
    assert len(names_of(out)) == 6
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def on_a_line(block, photo, relief):
    """The block in which `photo` sees only 60 tie points on a line of its frame, on ground with heights of `relief` m."""
    rng, ties, own = np.random.default_rng(9), block.tie_points, block.views[photo]
    pixels = np.column_stack([rng.uniform(50, 1950, 60), np.full(60, 560.0)])
    points = own.at_height(pixels, 100.0 + relief * rng.uniform(-1, 1, 60))
    kept = ties.take(ties.photo != photo)
    rows = [np.column_stack([kept.track, kept.photo, kept.col, kept.row])]
    for number, v in enumerate(block.views):
        seen = v.project(points)
        inside = np.flatnonzero(v.contains(seen, 5))
        noisy = seen[inside] + 0.3 * rng.standard_normal((len(inside), 2))
        rows.append(np.column_stack([ties.track.max() + 1 + inside, np.full(len(inside), number), noisy]))
    rows = np.vstack(rows)
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    sigma = np.full(len(rows), 0.3, np.float32)
    return replace(block, tie_points=type(ties)(*rows[:, :2].T.astype(np.int32), *rows[:, 2:].T, sigma))


@pytest.mark.parametrize("relief", [0.0, 15.0])
def test_a_photograph_with_all_points_on_a_line_is_named_and_the_rest_stands(relief):
    block = one_strip(5)
    out = orient(on_a_line(block, 7, relief))
    assert names_of(out) == {f"d{i}" for i in range(7)}
    (left,) = out["block"].unoriented
    assert left.photo == "d7" and "on one line" in left.reason and "all over the frame" in left.reason
    rest = replace(block, views=block.views[:7])
    assert np.abs(standardised_orientation(rest, out["block"])).max() < 4.5


def flat(seed):
    """One strip over a plane with a fully free camera and nothing but positions."""
    rng = np.random.default_rng(seed)
    views = [view(f"d{i}", DRONE, (407000 + 20 * i, 4357000 + rng.normal(0, 3), 180), (0, 0, 90)) for i in range(6)]
    block = simulate(views, DRONE, seed, gnss=3.0, control=0, check=0, tracks=800)
    points = block.ground.copy()
    points[:, 2] = 100.0
    ties = block.tie_points
    col, row = ties.col.copy(), ties.row.copy()
    for i, v in enumerate(views):
        own = ties.photo == i
        pixels = v.project(points[ties.track[own]]) + 0.3 * rng.standard_normal((own.sum(), 2))
        col[own], row[own] = pixels.T
    return replace(block, tie_points=replace(ties, col=col, row=row), ground=points)


def test_a_free_camera_constant_over_a_plane_is_held_and_named():
    out = orient(flat(3), interior=FreeInterior(kind="free", parameters=("c", "x0", "y0", "k1")))
    assert len(names_of(out)) == 6
    assert out["block"].cameras["cam"].c == DRONE.c
    assert any("Self-calibration" in text and "kept their values" in text for text in sentences(out["precision"]))


def test_a_free_camera_constant_with_control_is_found():
    block = two_strips(33)
    out = orient(block, interior=FreeInterior(kind="free", parameters=("c", "x0", "y0", "k1", "k2")))
    camera = out["block"].cameras["cam"]
    sigma = np.sqrt(np.diag(np.array(camera.covariance)))
    assert abs(camera.c - TRUE_CAMERA.c) < 4 * sigma[0]
    assert not any("Self-calibration" in text for text in sentences(out["precision"]))


def with_focal_length(block, factor, source):
    camera = calibrated(TRUE_CAMERA, np.random.default_rng(1))
    wrong = camera.model_copy(update={"c": factor * camera.c, "covariance": None, "source": source})
    return replace(block, cameras=block.cameras.model_copy(update={"cameras": {"cam": wrong}}))


KNOWN = {"control": {}, "positions": {"control": 0, "check": 0}, "nothing": {"gnss": None, "control": 0, "check": 0}}


def told_constant(out):
    """The one sentence about a contradicted camera constant."""
    (text,) = [text for text in sentences(out["precision"]) if "contradicts the camera constant of cam" in text]
    assert "Look for a wrong focal length" in text
    return text


@pytest.mark.slow
@pytest.mark.parametrize(("known", "factor"), [("control", 2.0), ("positions", 0.5), ("nothing", 0.5), ("nothing", 2.0)])
def test_a_rough_focal_length_wrong_by_two_is_named_and_mended_whatever_holds_the_block(factor, known):
    block = two_strips(34, tracks=600, **KNOWN[known])
    out = orient(with_focal_length(block, factor, "exif"))
    assert "which was used" in told_constant(out)
    assert len(names_of(out)) == 6 and out["precision"].blunders == ()
    camera = out["block"].cameras["cam"]
    assert camera.c == pytest.approx(TRUE_CAMERA.c, rel=0.01)
    assert abs(camera.c - TRUE_CAMERA.c) < 4 * np.sqrt(camera.covariance[0][0])
    if known != "nothing":
        assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_held_focal_length_wrong_by_two_is_named_and_held(factor):
    block = two_strips(34, tracks=300, control=4, check=0)
    out = orient(with_focal_length(block, factor, "given"), interior=FIXED)
    assert "the workflow fixes it" in told_constant(out)
    assert out["block"].cameras["cam"].c == pytest.approx(factor * TRUE_CAMERA.c, rel=0.01)


@pytest.mark.slow
def test_a_right_focal_length_is_not_blamed():
    for known in KNOWN.values():
        out = orient(with_focal_length(two_strips(37, tracks=600, **known), 1.0, "exif"))
        assert not any("contradicts the camera constant" in text for text in sentences(out["precision"]))


def test_positions_that_are_all_alike_do_not_place_a_block():
    block = two_strips(35, control=0, check=0)
    same = tuple(p.model_copy(update={"position": (0.0, 0.0, 0.0)}) for p in block.photos.photos)
    out = orient(replace(block, photos=Photos(photos=same)), interior=FIXED)
    assert len(names_of(out)) == 6 and out["block"].datum.startswith("Free network")
    assert any("closer together" in text for text in sentences(out["precision"]))


def test_a_photograph_without_tie_points_leaves_the_rest():
    block = two_strips(36)
    lone = photo_of(view("lone", TRUE_CAMERA, (500000, 4357000, 1138), (0, 0, 0)))
    cameras = block.cameras.model_copy(update={"of_photo": block.cameras.of_photo | {"lone": "cam"}})
    out = orient(replace(block, photos=Photos(photos=(*block.photos.photos, lone)), cameras=cameras))
    assert len(names_of(out)) == 6 and out["block"].unoriented[0].photo == "lone"


@pytest.mark.slow
def test_a_focal_length_wrong_by_two_is_named_with_oblique_views_too():
    """Every other photograph looks 30 degrees aside: nearly half of the measurements contradict the wrong constant at the start."""
    rng = np.random.default_rng(5035)
    views = [
        view(f"d{strip}{i}", DRONE, (407000 + 20 * i, 4357000 + 28 * strip, 180), (30 * (i % 2), 0, 90 + rng.normal(0, 3)))
        for strip in range(3)
        for i in range(4)
    ]
    block = simulate(views, DRONE.model_copy(update={"c": 0.5 * DRONE.c}), 35, gnss=3.0, control=0, check=0, tracks=800)
    out = orient(block)
    assert "which was used" in told_constant(out) and len(names_of(out)) == 12
    assert out["block"].cameras["cam"].c == pytest.approx(DRONE.c, rel=0.01)


def oblique(factor, seed=1):
    """Ten photographs in two strips that look 30 degrees to either side, the second flown back; GNSS only."""
    rng, views = np.random.default_rng(seed), []
    for i in range(10):
        strip, place = divmod(i, 5)
        xyz = (407000 + 20 * place + rng.normal(0, 0.5), 4357000 + 25 * strip + rng.normal(0, 0.5), 180 + rng.normal(0, 0.5))
        tilt = np.array([30, 0, 0]) if strip == 0 else np.array([-30, 0, 180])
        views.append(view(f"o{i}", DRONE, xyz, tilt + rng.normal(0, 1.5, 3)))
    nominal = DRONE.changed(c=factor * DRONE.c, k1=0.0)
    return simulate(views, nominal, seed, gnss=3.0, control=0, check=0, tracks=900)


@pytest.fixture(scope="module")
def oblique_with_the_right_constant():
    return orient(oblique(1.0))


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_focal_length_of_a_small_oblique_block_is_named_and_leaves_no_trace(factor, oblique_with_the_right_constant):
    out, right = orient(oblique(factor)), oblique_with_the_right_constant
    assert f"{factor * DRONE.c:.0f} px were given" in told_constant(out) and "which was used" in told_constant(out)
    assert out["block"].cameras["cam"].c == pytest.approx(DRONE.c, rel=0.01)
    assert out["block"].sigma0_px == pytest.approx(right["block"].sigma0_px, rel=0.02)
    assert out["precision"].rays >= 0.99 * right["precision"].rays, "tie points that the wrong constant cost come back"
    for name in right["block"].names:
        assert np.allclose(out["block"].of(name).centre, right["block"].of(name).centre, atol=1.0)


def with_a_camera_of_its_own(block, photo, factor):
    """The block in which one photograph has another focal length by its tags."""
    other = block.cameras.cameras["cam"].model_copy(update={"name": "zoom", "c": factor * block.cameras.cameras["cam"].c})
    changed = {"cameras": block.cameras.cameras | {"zoom": other}, "of_photo": block.cameras.of_photo | {photo: "zoom"}}
    return replace(block, cameras=block.cameras.model_copy(update=changed))


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_one_wrong_focal_length_among_many_is_the_only_one_that_changes(factor):
    out = orient(with_a_camera_of_its_own(one_strip(7, tracks=700), "d3", factor))
    (text,) = [text for text in sentences(out["precision"]) if "contradicts the camera constant" in text]
    assert "constant of zoom" in text and len(names_of(out)) == 8
    assert out["block"].cameras["zoom"].c == pytest.approx(1165.0, rel=0.03)
    assert out["block"].cameras["cam"].c == 1165.0


@pytest.mark.slow
def test_a_photograph_with_few_tie_points_in_a_corner_is_set_aside_and_the_rest_stands():
    """Eight tie points in a corner put it 130 m from its position."""
    rng, views = np.random.default_rng(1), []
    for i in range(10):
        xyz = np.array((407000 + 20 * (i % 5), 4357000 + 25 * (i // 5), 180)) + rng.normal(0, 0.5, 3)
        views.append(view(f"o{i}", DRONE, xyz, rng.normal(0, 1.5, 3)))
    block = simulate(views, DRONE.changed(k1=0.0), 1, gnss=3.0, control=0, check=0, tracks=900)
    ties = block.tie_points
    own = np.flatnonzero(ties.photo == 9)
    lost = own[np.argsort(ties.col[own] + ties.row[own])[8:]]
    out = orient(replace(block, tie_points=ties.take(~np.isin(np.arange(len(ties.photo)), lost))))
    assert names_of(out) == {f"o{i}" for i in range(9)}
    (left,) = out["block"].unoriented
    assert left.photo == "o9" and "was set aside" in left.reason and "More overlap" in left.reason
    assert out["block"].sigma0_px == pytest.approx(0.3, rel=0.1)


def folded(block, k1):
    camera = block.cameras.cameras["cam"].model_copy(update={"source": "given"}).changed(k1=k1)
    return replace(block, cameras=block.cameras.model_copy(update={"cameras": {"cam": camera}}))


@pytest.mark.slow
def test_a_distortion_that_folds_the_corners_is_told_in_a_sentence():
    (text,) = [text for text in sentences(orient(folded(one_strip(3, photos=4), -0.3))["precision"]) if "cannot be undone" in text]
    assert "The distortion of the camera cam" in text and "k1 = -0.3, c = 1165 px" in text and "another camera" in text


def test_a_block_that_folding_makes_impossible_says_so():
    with pytest.raises(GeometryError, match="cannot be undone"):
        orient(folded(one_strip(3, photos=2), -30.0))


@pytest.mark.parametrize("k1", [-0.6, -3.0, -30.0])
def test_pairs_of_a_folding_camera_are_related_by_what_can_be_undone(k1):
    """Points beyond the fold have no ideal place: they used to reach the decomposition of a matrix."""
    block = folded(one_strip(3, photos=2), k1)
    (pair,) = relate_pairs(block.photos, block.cameras, block.tie_points, 15).pairs
    assert pair.kept < 0.95 * len(block.ground) and pair.outcome
