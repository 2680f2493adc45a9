"""A fixed block: placed by positions, examined with tie points and surveyed points, doubted where they contradict it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_block import TRUE_CAMERA, two_strips

from orthomill.schemas.camera import Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.foreign_findings import BlockElsewhere, BlockUnexamined, PhotosUnknown, TiePointsMisfit
from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import GroundResidual
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.orientation.exterior.fixed_block import orient_fixed, placed_block
from orthomill.tasks.orientation.exterior.fixed_block_doubts import elsewhere, rays_that_do_not_meet, tie_points_misfit
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock, ForeignPose
from orthomill.tasks.orientation.orientation_settings import FromAngles

CRS = "EPSG:2100"
ANGLES = FromAngles(kind="csv", path="ori.csv")
BY_POSITIONS = FromAngles(kind="csv", path="ori.csv", placed="positions")


def table_of(views, sigma=None):
    """The CSV of the true orientations, with six standard errors where they are stated."""
    lines = ["photo,x,y,z,omega,phi,kappa" + (",sigma_x,sigma_y,sigma_z,sigma_omega,sigma_phi,sigma_kappa" if sigma else "")]
    for view in views:
        numbers = [*view.centre, *np.degrees(angles(view.rotation)), *(sigma or ())]
        lines.append(",".join([view.name, *(repr(float(v)) for v in numbers)]))
    return "\n".join(lines)


@pytest.fixture(scope="module")
def block():
    return two_strips(4, tracks=400)


@pytest.fixture(scope="module")
def cameras(block):
    return block.cameras.model_copy(update={"cameras": {"cam": TRUE_CAMERA}})


@pytest.fixture(scope="module")
def tables(block, cameras):
    return orient_fixed(block.photos, cameras, block.control, (table_of(block.views),), ANGLES, CRS, block.tie_points)


def examined(block, cameras, **changes):
    known = {"photos": block.photos, "control": block.control, "tie_points": block.tie_points, "texts": (table_of(block.views),)}
    return orient_fixed(cameras=cameras, source=ANGLES, crs=CRS, **(known | changes))


def test_the_orientation_is_taken_as_it_is(block, tables):
    for view in block.views:
        found = tables.block.of(view.name)
        assert np.allclose(found.centre, view.centre, atol=1e-9)
        assert np.allclose(rotation_matrix(*np.radians(found.omega_phi_kappa)), view.rotation, atol=1e-12)
    assert tables.block.datum == "Fixed: the exterior orientation of 6 photographs was read from ori.csv and not adjusted."
    assert tables.block.iterations == 0 and tables.separate is None


def test_true_orientations_leave_the_noise_of_the_measurements(tables):
    assert tables.precision.image_factor == pytest.approx(1.0, abs=0.07)
    assert tables.precision.findings == ()


def test_residuals_of_points_and_photographs_come_from_the_same_rays(tables):
    image, points = tables.image_residuals, tables.points
    used = image.take(image.used)
    square = (used.v_col.astype(float) ** 2 + used.v_row.astype(float) ** 2) / 2
    for track, rays, residual in zip(points.track[:20], points.rays[:20], points.residual[:20], strict=True):
        own = used.track == track
        assert own.sum() == rays
        assert np.sqrt(square[own].mean()) == pytest.approx(residual, rel=1e-4)


def test_intersected_points_have_realistic_standard_errors(block, tables):
    points = tables.points
    error = np.column_stack([points.x, points.y, points.z]) - block.ground[points.track]
    sigma = np.column_stack([points.sigma_x, points.sigma_y, points.sigma_z])
    assert np.sqrt(((error / sigma) ** 2).mean()) == pytest.approx(1.0, abs=0.1)


def test_the_redundancy_counts_two_per_ray_and_three_per_point(tables):
    assert tables.block.redundancy == 2 * tables.image_residuals.used.sum() - 3 * len(tables.points)


def test_ground_heights_are_those_of_the_tie_points(tables):
    assert (tables.block.ground_low, tables.block.ground_high) == pytest.approx(np.percentile(tables.points.z, [0.5, 99.5]))


@pytest.mark.parametrize("times", [0.5, 2.0])
def test_the_factor_is_estimated_by_stated(block, cameras, tables, times):
    ties = block.tie_points
    stated = replace(ties, sigma=(times * ties.sigma).astype(np.float32))
    found = examined(block, cameras, tie_points=stated)
    assert found.precision.image_factor == pytest.approx(tables.precision.image_factor / times, rel=0.02)
    assert np.allclose(found.points.sigma_z, tables.points.sigma_z, rtol=0.02), "the factor brings standard errors to the residuals"


def test_wrong_matches_are_rejected_and_most_of_the_others_stay():
    block = two_strips(4, tracks=400, wrong=0.05)
    cameras = block.cameras.model_copy(update={"cameras": {"cam": TRUE_CAMERA}})
    image = examined(block, cameras).image_residuals
    wrong = {(t, p) for t, p in zip(block.tie_points.track[block.wrong], block.tie_points.photo[block.wrong], strict=True)}
    used = {(t, p) for t, p in zip(image.track[image.used], image.photo[image.used], strict=True)}
    assert len(wrong & used) < 0.15 * len(wrong)
    assert len(used) > 0.85 * (len(block.tie_points) - len(wrong))
    assert np.isnan(image.standardised[~image.used]).all() and np.isfinite(image.standardised[image.used]).all()


def test_surveyed_points_are_compared_whatever_their_role(block, tables):
    rows = tables.ground_residuals.points
    assert {row.name for row in rows if row.role != "position"} == {point.name for point in block.control.points}
    ratio = [np.array(row.difference) / row.predicted for row in rows if row.role != "position"]
    assert np.abs(ratio).max() < 4.5


def test_a_point_measured_once_is_not_compared(block, cameras):
    point = block.control.points[0]
    once = point.model_copy(update={"measurements": dict([next(iter(point.measurements.items()))])})
    rows = examined(block, cameras, control=Control(points=(once,))).ground_residuals.points
    assert {row.role for row in rows} == {"position"}


def test_stated_standard_errors_become_the_covariance(block, cameras):
    sigma = (0.1, 0.2, 0.3, 0.01, 0.02, 0.03)
    found = examined(block, cameras, texts=(table_of(block.views, sigma),)).block.photos[0]
    expected = np.array(sigma) * np.repeat([1.0, np.radians(1.0)], 3)
    assert np.allclose(np.sqrt(np.diag(found.covariance)), expected)


def test_photographs_of_one_side_only_are_named(block, cameras):
    views = block.views[:5]
    text = table_of(views) + "\nstranger,1,2,3,0,0,0"
    found = examined(block, cameras, texts=(text,))
    (left,) = found.block.unoriented
    assert left.photo == block.views[5].name and "is not in the block that was read from ori.csv" in left.reason
    assert found.precision.findings == (PhotosUnknown(photos=("stranger",)),)


def test_tie_points_that_contradict_the_orientation_are_a_finding(block, cameras):
    tilt = rotation_of_vector(np.array([0.02, 0, 0]))
    turned = [replace(v, rotation=tilt @ v.rotation if i % 2 else v.rotation) for i, v in enumerate(block.views)]
    found = examined(block, cameras, texts=(table_of(turned),))
    (misfit,) = [finding for finding in found.precision.findings if isinstance(finding, TiePointsMisfit)]
    assert misfit.factor > 5 and misfit.rms_px == found.block.sigma0_px and misfit.source == "ori.csv"


def test_positions_elsewhere_are_a_finding_with_the_median_offset(block, cameras):
    moved = [replace(v, centre=v.centre + np.array([0, 0, 43.0])) for v in block.views]
    found = examined(block, cameras, texts=(table_of(moved),))
    (finding,) = [finding for finding in found.precision.findings if isinstance(finding, BlockElsewhere)]
    assert finding.offset == pytest.approx((0, 0, 43.0), abs=0.3)


def test_without_tie_points_the_block_is_unexamined_and_needs_the_height_of_the_ground(block, cameras):
    with pytest.raises(GeometryError, match=r"Nothing determines the height of the ground .* or give `ground`"):
        examined(block, cameras, tie_points=None)
    source = ANGLES.model_copy(update={"ground": (90.0, 150.0)})
    found = orient_fixed(block.photos, cameras, block.control, (table_of(block.views),), source, CRS)
    assert found.precision.findings == (BlockUnexamined(source="ori.csv"),)
    assert (found.block.ground_low, found.block.ground_high) == (90.0, 150.0)
    assert found.precision.image_factor == 1.0 and len(found.points) == len(found.image_residuals) == 0


def foreign(rng, count=6, line=False):
    """Poses with random rotations; centres in a cube of 100 m, or along a line."""
    centres = np.outer(np.arange(count), [20.0, 0.0, 0.0]) if line else rng.uniform(-50, 50, (count, 3))
    poses = {f"p{i}": ForeignPose(rotation_of_vector(0.1 * rng.standard_normal(3)), centres[i]) for i in range(count)}
    return ForeignBlock(poses, {}, rng.uniform(-50, 50, (10, 3)))


def at_positions(centres, sigma=(0.1,) * 3):
    size = {"width": 100, "height": 80, "bands": 3, "dtype": "uint8", "camera": "cam"}
    names, places = [f"p{i}" for i in range(len(centres))], [tuple(map(float, c)) for c in centres]
    photos = [Photo(name=n, path=n, position=c, position_sigma=sigma, **size) for n, c in zip(names, places, strict=True)]
    of_photo = {photo.name: "cam" for photo in photos}
    return Photos(photos=tuple(photos)), Cameras(cameras={"cam": TRUE_CAMERA}, of_photo=of_photo)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10**6), st.floats(0.01, 100.0))
def test_a_similarity_to_exact_positions_is_recovered(seed, scale):
    rng = np.random.default_rng(seed)
    block, turn, shift = foreign(rng), rotation_of_vector(rng.standard_normal(3)), np.array([400_000.0, 4_300_000.0, 100.0])

    def true(points):
        return scale * points @ turn.T + shift

    photos, cameras = at_positions(true(np.array([pose.centre for pose in block.poses.values()])))
    placed = placed_block(block, photos, cameras, BY_POSITIONS)
    assert np.allclose(placed.points, true(block.points), atol=1e-6 * max(scale, 1.0))
    for view in placed.views:
        before = block.poses[view.name]
        assert np.allclose(view.centre, true(before.centre[None])[0], atol=1e-6 * max(scale, 1.0))
        assert np.allclose(view.rotation, before.rotation @ turn.T, atol=1e-7)


def test_positions_on_a_line_take_the_up_direction_from_the_photographs():
    block = foreign(np.random.default_rng(2), line=True)
    block = ForeignBlock({name: ForeignPose(np.eye(3), pose.centre) for name, pose in block.poses.items()}, {}, block.points)
    tilted = rotation_of_vector(np.array([0.7, 0.0, 0.0]))
    photos, cameras = at_positions(np.array([pose.centre for pose in block.poses.values()]) @ tilted.T)
    for view in placed_block(block, photos, cameras, BY_POSITIONS).views:
        assert np.allclose(view.rotation[2], [0, 0, 1], atol=1e-6), "the photographs look down, for nothing says otherwise"


def test_fewer_than_three_positions_place_no_block():
    block = foreign(np.random.default_rng(3), count=2)
    photos, cameras = at_positions(np.zeros((2, 3)))
    with pytest.raises(GeometryError, match=r"only 2 of them have one; three are needed.*placed: project"):
        placed_block(block, photos, cameras, BY_POSITIONS)


def test_a_block_of_the_project_stays_where_it_is():
    block = foreign(np.random.default_rng(3))
    photos, cameras = at_positions(np.zeros((6, 3)))
    placed = placed_block(block, photos, cameras, ANGLES)
    assert all(view.centre is block.poses[view.name].centre for view in placed.views) and placed.points is block.points


def test_the_camera_of_the_file_goes_before_that_of_the_project():
    block = foreign(np.random.default_rng(3))
    own = TRUE_CAMERA.model_copy(update={"name": "theirs", "c": 1.0})
    photos, cameras = at_positions(np.zeros((6, 3)))
    views = placed_block(ForeignBlock(block.poses, {"p1": own}, block.points), photos, cameras, ANGLES).views
    assert [view.camera.name for view in views] == ["cam", "theirs", "cam", "cam", "cam", "cam"]


def position(difference, sigma=1.0):
    return GroundResidual(name="p", role="position", difference=difference, predicted=(sigma,) * 3, photos=1)


def test_no_positions_contradict_nothing():
    assert elsewhere([], "x") == ()


@pytest.mark.parametrize(("far", "found"), [(2, False), (3, True)])
def test_half_of_the_positions_must_be_far_off(far, found):
    rows = [position((0.0, 0.0, 9.0))] * far + [position((0.1, 0.0, 0.0))] * (5 - far)
    assert bool(elsewhere(rows, "x")) == found


@pytest.mark.parametrize(("factor", "found"), [(4.9, ()), (5.0, (TiePointsMisfit(source="x", rms_px=3.0, factor=5.0),))])
def test_tie_points_misfit_from_five_times_their_standard_error(factor, found):
    assert tie_points_misfit(3.0, factor, "x") == found


def test_the_error_of_diverging_rays_names_the_convention_and_the_remedy():
    text = rays_that_do_not_meet(321, "ori.csv")
    assert "321 tie points" in text and "R3(kappa) R2(phi) R1(omega)" in text and "Convert the angles" in text
