"""Whole blocks against truth: two strips with control, one drone strip with rough positions, and blocks with something wrong."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import ground_errors, orient, sentences, standardised_lengths, standardised_orientation
from simulated_block import DRONE, one_strip, photo_of, simulate, two_strips, view

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior, FreeInterior, WeightedInterior
from orthomill.tasks.orientation.report.block_report import report


def test_two_strips_are_oriented_within_their_standard_errors(volos_like):
    block, out = volos_like
    result = out["block"]
    assert len(result.photos) == 6 and not result.unoriented
    assert np.abs(standardised_orientation(block, result)).max() < 4.5
    assert abs(result.sigma0_px / 0.3 - 1) < 0.05
    assert result.datum.startswith("Control: the datum is defined by 8 ground control points")


def test_wrong_measurements_are_rejected_and_right_ones_kept(volos_like):
    block, out = volos_like
    image, ties = out["image_residuals"], block.tie_points
    wrong = {(t, p) for t, p in zip(ties.track[block.wrong], ties.photo[block.wrong], strict=True)}
    used = {(t, p) for t, p in zip(image.track[image.used], image.photo[image.used], strict=True)}
    rays = np.bincount(ties.track)
    safe = {(t, p) for t, p in wrong if rays[t] >= 4}
    assert len(safe) > 5
    assert len(safe & used) <= 0.1 * len(safe)
    assert image.used[image.track >= 0].sum() > 0.94 * len(ties)


def test_check_points_meet_the_figures(volos_like):
    check = volos_like[1]["ground_residuals"].of_role("check")
    difference = np.array([p.difference for p in check])
    assert len(check) == 8
    assert np.sqrt((difference[:, :2] ** 2).sum(axis=1).mean()) < 0.40
    assert np.sqrt((difference[:, 2] ** 2).mean()) < 0.65
    assert np.abs(difference / [p.predicted for p in check]).max() < 4


def test_ground_points_have_honest_standard_errors(volos_like):
    block, out = volos_like
    error, sigma = ground_errors(block, out["points"])
    middle = np.percentile(np.abs(error / sigma), 68.3, axis=0)
    assert (np.abs(middle - 1) < 0.12).all()


def test_check_points_take_no_part():
    block = two_strips(5)
    moved = tuple(p if p.role == "control" else p.model_copy(update={"xyz": (0.0, 0.0, 0.0)}) for p in block.control.points)
    assert orient(block)["block"] == orient(replace(block, control=Control(points=moved)))["block"]


def test_one_strip_with_rough_positions_says_that_its_tilt_is_assumed():
    block = one_strip(1, wrong=0.02)
    out = orient(block)
    result = out["block"]
    assert len(result.photos) == 8
    assert np.abs(standardised_orientation(block, result)).max() < 4
    assert "straight down" in result.datum
    assert any("so near to one line" in text for text in sentences(out["precision"]))
    sigma = np.sqrt(np.diag(np.array(result.photos[3].covariance)))
    assert np.degrees(sigma[3:].max()) > 2
    assert np.degrees(sigma[3:].min()) < 2


@pytest.mark.slow
def test_a_nominal_camera_constant_is_kept_without_control_and_its_uncertainty_reaches_the_ground():
    block = one_strip(4)
    out = orient(block)
    camera = out["block"].cameras["cam"]
    assert camera.c == 1165.0 and camera.covariance[0][0] == pytest.approx((0.03 * 1165) ** 2)
    assert any("nominal" in text for text in sentences(out["precision"]))
    sure = orient(block, interior=WeightedInterior(kind="weighted", parameters=("k1",)))
    assert np.median(out["points"].sigma_z) > np.median(sure["points"].sigma_z) + 0.5


def test_free_network_without_positions_and_control():
    block = two_strips(2, np.zeros(8), gnss=None, control=0, check=0)
    result = orient(block, interior=FixedInterior(kind="fixed"))["block"]
    assert result.datum.startswith("Free network")
    truth = np.array([v.centre for v in block.views])
    found = np.array([result.of(v.name).centre for v in block.views])
    scale = np.linalg.norm(truth - truth.mean(axis=0)) / np.linalg.norm(found - found.mean(axis=0))
    assert np.abs(standardised_lengths(block, result, scale)).max() < 4


def test_positions_alone_hold_two_strips():
    block = two_strips(4, control=0)
    result = orient(block)["block"]
    assert result.datum.startswith("GNSS: the datum is defined by 6 GNSS positions") and "straight" not in result.datum
    assert np.abs(standardised_orientation(block, result)).max() < 4.5


def test_shift_of_the_positions_is_found_with_control():
    block = two_strips(6)
    shift = np.array([3.0, -2.0, 5.0])
    moved = tuple(p.model_copy(update={"position": tuple(np.array(p.position) + shift)}) for p in block.photos.photos)
    out = orient(replace(block, photos=Photos(photos=moved)), gnss_shift="constant")
    error = (np.array(out["precision"].gnss_shift) - shift) / out["precision"].gnss_shift_sigma
    assert np.abs(error).max() < 4
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_shift_without_control_is_refused():
    with pytest.raises(GeometryError, match="shift"):
        orient(two_strips(6, control=0), gnss_shift="constant")


@pytest.mark.slow
@pytest.mark.parametrize(("share", "guessed"), [(0.25, True), (0.03, False)])
def test_a_camera_constant_that_nothing_told_is_found_and_not_contradicted(share, guessed):
    block = two_strips(9)
    camera = block.cameras.cameras["cam"]
    c, cov = 0.4 * camera.c, np.zeros((17, 17))
    cov[0, 0] = (share * c) ** 2
    wrong = camera.model_copy(update={"c": c, "covariance": tuple(map(tuple, cov.tolist()))})
    precision = orient(replace(block, cameras=block.cameras.model_copy(update={"cameras": {"cam": wrong}})))["precision"]
    (found,) = [finding for finding in precision.findings if finding.code == "constant_contradicted"]
    assert found.guessed == guessed and abs(found.adjusted_px / camera.c - 1) < 0.01


@pytest.mark.parametrize(
    ("counted", "said"),
    [
        (lambda photo, c, r: (r, c), "the row before the column: "),
        (lambda photo, c, r: (c, photo.height - 1 - r), "from the lower left corner: "),
        (lambda photo, c, r: ((c + 0.5) / 2 - 0.5, (r + 0.5) / 2 - 0.5), "in copies reduced by 2: "),
    ],
)
def test_the_way_in_which_marks_are_counted_is_named_and_used(counted, said):
    block = two_strips(6, gnss=None)
    measured = {
        p.name: {photo: (*counted(block.photos[photo], c, r), s) for photo, (c, r, s) in p.measurements.items()}
        for p in block.control.points
    }
    points = tuple(p.model_copy(update={"measurements": measured[p.name]}) for p in block.control.points)
    out = orient(replace(block, control=Control(points=points)))
    (found,) = [text for text in sentences(out["precision"]) if said in text]
    assert "the rays of a point meet to 0." in found
    assert not any("contradict" in text for text in sentences(out["precision"])), "counted so, control agrees with the block"


def test_marks_under_wrong_names_are_not_explained_by_counting():
    """Rays of different points, some of them parallel: they meet at infinity."""
    block = two_strips(6, gnss=None)
    points = block.control.points
    mixed = []
    for own, other in zip(points, points[1:] + points[:1], strict=True):
        every_second = {name: other.measurements.get(name, mark) for name, mark in list(own.measurements.items())[1::2]}
        mixed.append(own.model_copy(update={"measurements": own.measurements | every_second}))
    found = sentences(orient(replace(block, control=Control(points=tuple(mixed))))["precision"])
    assert any("they pull against its tie points" in text for text in found) and not any("counted" in text for text in found)


def test_wrong_stated_precision_of_images_is_corrected():
    block = two_strips(7, stated_sigma=0.6)
    out = orient(block)
    assert 0.45 < out["precision"].image_factor < 0.55
    assert abs(out["block"].sigma0_px / 0.3 - 1) < 0.05


def test_positions_worse_than_stated_are_named():
    block = two_strips(8, gnss=5.0)
    sure = tuple(p.model_copy(update={"position_sigma": (0.1, 0.1, 0.1)}) for p in block.photos.photos)
    out = orient(replace(block, photos=Photos(photos=sure)))
    assert out["precision"].position_factor > 10
    assert np.abs(standardised_orientation(block, out["block"])).max() < 4.5


def test_self_calibration_with_control_recovers_the_camera():
    block = two_strips(9)
    result = orient(block, interior=FreeInterior(kind="free", parameters=("c", "x0", "y0", "k1")))["block"]
    camera, truth = result.cameras["cam"], block.views[0].camera
    sigma = np.sqrt(np.diag(np.array(camera.covariance)))
    assert abs(camera.c - truth.c) < 4 * sigma[0] and sigma[0] < 5
    assert camera.lens.k2 == block.cameras.cameras["cam"].lens.k2


def two_groups_and_a_lone_photograph(gnss):
    """Five photos, three others ten kilometres away (with positions of `gnss`), and one without tie points."""
    far = [view(f"far{i}", DRONE, (417000 + 20 * i, 4357000, 180), (0, 0, 90)) for i in range(3)]
    near = [view(f"near{i}", DRONE, (407000 + 20 * i, 4357000, 180), (0, 0, 90)) for i in range(5)]
    lone = view("alone", DRONE, (437000, 4357000, 180), (0, 0, 90))
    one = simulate(near, DRONE, 1, gnss=1.0, control=0, check=0, tracks=600)
    two = simulate(far, DRONE, 2, gnss=gnss, control=0, check=0, tracks=600)
    three = photo_of(lone)
    ties = replace(
        one.tie_points,
        track=np.concatenate([one.tie_points.track, two.tie_points.track + 10000]).astype(np.int32),
        photo=np.concatenate([one.tie_points.photo, two.tie_points.photo + 5]).astype(np.int32),
        col=np.concatenate([one.tie_points.col, two.tie_points.col]),
        row=np.concatenate([one.tie_points.row, two.tie_points.row]),
        sigma=np.concatenate([one.tie_points.sigma, two.tie_points.sigma]),
    )
    photos = Photos(photos=(*one.photos.photos, *two.photos.photos, three))
    cameras = one.cameras.model_copy(update={"of_photo": dict.fromkeys(photos.names, "cam")})
    return replace(one, photos=photos, cameras=cameras, tie_points=ties), [*near, *far]


def test_separate_groups_with_positions_share_one_system_and_are_named():
    block, views = two_groups_and_a_lone_photograph(gnss=1.0)
    out = orient(block)
    result = out["block"]
    assert set(result.names) == {v.name for v in views}
    assert result.groups == (tuple(f"near{i}" for i in range(5)), tuple(f"far{i}" for i in range(3)))
    assert np.abs(standardised_orientation(replace(block, views=views), result)).max() < 4.5
    assert any("2 groups" in text and "far1" in text for text in sentences(out["precision"]))
    assert [u.photo for u in result.unoriented] == ["alone"] and "no tie points" in result.unoriented[0].reason


def test_a_group_without_positions_is_kept_as_a_block_of_its_own():
    block, _ = two_groups_and_a_lone_photograph(gnss=None)
    out = orient(block)
    assert out["block"].names == tuple(f"near{i}" for i in range(5))
    (separate,) = out["separate"].blocks
    assert separate.names == ("far0", "far1", "far2") and separate.datum.startswith("Free network")
    assert any("free block of its own" in text and "far1" in text for text in sentences(out["precision"]))


def test_no_overlap_at_all_is_one_clear_sentence():
    block = one_strip(0, photos=2, tracks=40)
    col, row = np.random.default_rng(1).uniform(0, [[1999], [1124]], (2, len(block.tie_points)))
    shuffled = replace(block.tie_points, col=col, row=row)
    # Of a camera that is given no distortions are tried, each of which is another search through wrong matches.
    given = block.cameras.model_copy(update={"cameras": {"cam": DRONE.model_copy(update={"source": "given"})}})
    with pytest.raises(GeometryError, match="No two photographs could be oriented"):
        orient(replace(block, tie_points=shuffled, cameras=given))


def test_the_report_agrees_with_the_block(volos_like):
    block, out = volos_like
    told = report(block.photos, block.cameras, block.control, **{name: out[name] for name in out if name != "separate"})
    figures = {figure.name: figure.value for figure in told.figures}
    assert figures["photos_oriented"] == 6
    assert figures["sigma0_um"] == pytest.approx(96 * out["block"].sigma0_px)
    assert 0.5 < figures["check_by_predicted"] < 1.6
    assert figures["image_measurements"] + figures["image_measurements_rejected"] == len(block.tie_points) + sum(
        len(p.measurements) for p in block.control.points if p.role == "control"
    )
    titles = {grid.title for grid in told.grids}
    assert {"Cameras", "Exterior orientation", "Ground control", "Check points (took no part)", "GNSS positions"} <= titles
    told.model_dump_json()


@pytest.mark.slow
def test_standard_errors_are_honest_over_twelve_seeds():
    orientation, checks, interior, joint = [], [], [], []
    for seed in range(12):
        block = two_strips(100 + seed, tracks=500)
        out = orient(block)
        orientation.append(standardised_orientation(block, out["block"]))
        checks += [np.array(p.difference) / p.predicted for p in out["ground_residuals"].of_role("check")]
        joint.append(out["ground_residuals"].checked)
        camera = out["block"].cameras["cam"]
        sigma = np.sqrt(np.diag(np.array(camera.covariance)))
        interior.append((camera.c - block.views[0].camera.c) / sigma[0])
    assert (np.abs(np.array(orientation)) < 3).mean() > 0.97
    assert np.abs(np.sqrt((np.array(orientation) ** 2).mean(axis=(0, 1))) - 1).max() < 0.25
    assert abs(np.sqrt((np.array(checks) ** 2).mean()) - 1) < 0.15
    assert np.abs(interior).max() < 3.5
    # Together in their joint covariance: the mean of chi-squared is its degrees of freedom, here with 12 times as many.
    degrees, square = sum(test.coordinates for test in joint), sum(test.square for test in joint)
    assert abs(square - degrees) < 3.5 * np.sqrt(2 * degrees) and min(test.chance for test in joint) > 0.001
