"""The tables of an adjusted block agree with each other, and with the adjustment that they come from."""

import numpy as np
import pytest

from orthomill.schemas.camera import INTERIOR
from orthomill.tasks.orientation.results.ground_results import _of_residual
from orthomill.tasks.orientation.results.products import PRODUCTS, block_products, outgoing


@pytest.fixture(scope="module")
def tables(volos_like):
    return volos_like[1]


def used_ties(tables):
    image = tables["image_residuals"]
    return image.take(image.used & (image.track >= 0))


def test_points_count_the_used_rays(tables):
    points, used = tables["points"], used_ties(tables)
    rays = np.bincount(used.track, minlength=points.track.max() + 1)
    assert (rays[points.track] == points.rays).all() and points.rays.min() >= 2
    assert (np.diff(points.track) > 0).all()


def test_the_residual_of_a_point_is_that_of_its_rays(tables):
    points, used = tables["points"], used_ties(tables)
    square = (used.v_col.astype(float) ** 2 + used.v_row.astype(float) ** 2) / 2
    mean = np.bincount(used.track, square, minlength=points.track.max() + 1)[points.track] / points.rays
    assert np.allclose(np.sqrt(mean), points.residual, rtol=1e-4)


def test_the_residual_of_a_photograph_is_that_of_its_measurements(volos_like, tables):
    block, image = volos_like[0], tables["image_residuals"]
    for photo in tables["block"].photos:
        own = image.take(image.used & (image.photo == block.photos.names.index(photo.photo)))
        rms = np.sqrt((own.v_col.astype(float) ** 2 + own.v_row.astype(float) ** 2).mean() / 2)
        assert len(own) == photo.observations and rms == pytest.approx(photo.residual_px, rel=1e-4)


def test_measurements_are_sorted_and_complete(volos_like, tables):
    block, image = volos_like[0], tables["image_residuals"]
    assert (np.diff(image.track) >= 0).all()
    assert image.used.sum() == tables["precision"].rays
    assert len(image) <= tables["precision"].rays + tables["precision"].rejected, "points without a place are not in the table"
    control = {-1 - i for i, point in enumerate(block.control.points) if point.role == "control"}
    assert {int(t) for t in image.track[image.track < 0]} == control


def test_rejected_measurements_have_no_standardised_residual(tables):
    image = tables["image_residuals"]
    assert np.isnan(image.standardised[~image.used]).all() and np.isfinite(image.standardised[image.used]).all()


def test_ground_heights_leave_out_half_a_percent_on_either_side(tables):
    block, points = tables["block"], tables["points"]
    assert (block.ground_low, block.ground_high) == pytest.approx(np.percentile(points.z, [0.5, 99.5]), abs=0.05)


def test_covariances_of_two_photographs_are_those_of_one_joint_matrix(tables):
    """Symmetric and positive definite as a whole: the difference of two photographs has a positive variance in every direction."""
    block = tables["block"]
    assert block.joint
    for pair in block.joint:
        own = [np.array(block.of(name).covariance) for name in (pair.first, pair.second)]
        joint = np.block([[own[0], np.array(pair.covariance)], [np.array(pair.covariance).T, own[1]]])
        scale = np.sqrt(np.diag(joint))
        assert np.linalg.eigvalsh(joint / np.outer(scale, scale)).min() > 0


def test_pairs_have_a_covariance_where_they_share_points(volos_like, tables):
    used, names = used_ties(tables), volos_like[0].photos.names
    seen = np.zeros((len(names), used.track.max() + 1), bool)
    seen[used.photo, used.track] = True
    shared = {(names[i], names[j]) for i in range(len(names)) for j in range(i + 1, len(names)) if (seen[i] & seen[j]).any()}
    assert shared <= {(pair.first, pair.second) for pair in tables["block"].joint}


def test_an_adjusted_camera_carries_its_covariance_and_its_correlation_with_photographs(tables):
    block = tables["block"]
    camera = block.cameras["cam"]
    assert camera.source == "block" and camera.sigma0 == block.sigma0_px
    interior = np.array(camera.covariance)
    assert interior.shape == (17, 17) and np.allclose(interior, interior.T)
    for photo in block.photos:
        own, both = np.array(photo.covariance), np.array(photo.with_interior["cam"])
        joint = np.block([[own, both], [both.T, interior]])
        free = np.diag(joint) > 0
        scale = np.sqrt(np.diag(joint)[free])
        assert np.linalg.eigvalsh(joint[np.ix_(free, free)] / np.outer(scale, scale)).min() > -1e-9


def test_parameters_without_prior_knowledge_of_their_uncertainty_stay_fixed(volos_like, tables):
    before, after = volos_like[0].cameras.cameras["cam"], tables["block"].cameras["cam"]
    variance = dict(zip(INTERIOR, np.diag(np.array(after.covariance)), strict=True))
    assert variance["k3"] == 0 and after.lens.k3 == before.lens.k3
    assert variance["c"] > 0 and after.c != before.c


def test_strong_correlations_are_listed_once(tables):
    pairs = [(c.first, c.second) for c in tables["precision"].correlations]
    assert len({frozenset(pair) for pair in pairs}) == len(pairs)
    assert all(0.9 <= abs(c.value) <= 1.0 + 1e-9 for c in tables["precision"].correlations)


def test_largest_residuals_are_measurements_of_the_table(volos_like, tables):
    image, names = tables["image_residuals"], volos_like[0].photos.names
    rows = [row for row in tables["precision"].largest if row.point.startswith("tie point ")]
    for row in rows:
        own = (image.track == int(row.point.removeprefix("tie point "))) & (image.photo == names.index(row.photo))
        assert own.sum() == 1 and image.used[own].all()
        v = (image.v_col if row.axis == "x" else image.v_row)[own][0]
        assert abs(v) == pytest.approx(abs(row.residual_px), rel=1e-4)
        # The table of images has the larger of both axes, and both may be among the largest.
        both = [abs(other.standardised) for other in rows if (other.point, other.photo) == (row.point, row.photo)]
        assert image.standardised[own][0] == pytest.approx(max(both), rel=1e-4)


def test_residuals_of_control_are_smaller_than_differences_of_checks(tables):
    """A point that takes part pulls the block towards itself, so its predicted residual is below its own standard error."""
    ground = tables["ground_residuals"]
    assert all((np.array(row.predicted) < 0.02).all() for row in ground.of_role("control"))
    assert all((np.array(row.predicted) > 0.02).all() for row in ground.of_role("check"))


@pytest.mark.parametrize(("spread", "white"), [(0.3, 0.3), (0.5, 0.3)])
def test_the_variance_of_a_residual_follows_from_white_noise_and_what_is_correlated(spread, white):
    """Qvv = Qll - A Qxx A^T for the weights of the adjustment; correlated image errors come on top."""
    found = _of_residual(np.array([2.0]), np.array([spread]), np.array([white]))
    assert found == pytest.approx(1 / 2.0 - white + (spread - white))


@pytest.fixture(scope="module")
def texts(volos_like):
    block, result = volos_like
    return {name: product.text for name, product in block_products(block.photos, result["block"], result["points"]).items()}


def test_every_product_has_a_text_and_a_file_of_its_own(texts):
    assert set(texts) == set(PRODUCTS) and all(texts.values())
    assert len(set(PRODUCTS.values())) == len(PRODUCTS)


def test_coordinates_for_colmap_are_small_numbers(volos_like, texts):
    """Programs that compute in float32 lose decimetres in millions of metres; the origin is stated in whole hundreds."""
    line = next(line for line in texts["images.txt"].splitlines() if line.startswith("# Coordinates"))
    origin = np.array(line.partition(":")[2].split()[:3], float)
    assert (origin % 100 == 0).all() and origin[2] == 0
    rows = [row.split() for row in texts["points3D.txt"].splitlines() if row and not row.startswith("#")]
    assert np.abs(np.array([row[1:3] for row in rows], float)).max() < 5000
    assert len(rows) == len(volos_like[1]["points"])


def test_a_mirrored_photograph_leaves_upright(volos_like):
    block, result = volos_like
    name = block.photos.names[0]
    mirrored = block.photos.model_copy(
        update={"photos": tuple(p.model_copy(update={"exif_orientation": 2}) if p.name == name else p for p in block.photos.photos)}
    )
    one, other = (outgoing(photos, result["block"], result["points"]) for photos in (block.photos, mirrored))
    assert np.allclose(one.poses[name].rotation, other.poses[name].rotation)
    assert one.cameras[name] == other.cameras[name]
