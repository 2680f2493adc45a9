"""The published matching experiment, regenerated: its acceptance values, its geometry, and windows without seams."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.matching.dissertation_pair import (
    CLEAN,
    NOISY,
    TEXTURE_CELL,
    TEXTURE_NORTH,
    TEXTURE_SHAPE,
    TEXTURE_WEST,
    GroundTexture,
    check_points,
    ground_texture,
    mirrored,
    pair_crop,
    rendered,
)
from benchmarks.matching.dissertation_surface import (
    SIDE,
    PublishedPhoto,
    grid_points,
    heights,
    intersected,
    projected,
    surface_points,
    true_matches,
)
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.resampling import sample_cubic

WINDOW = Window(5200, 6000, 90, 130)


@pytest.fixture(scope="module")
def texture() -> GroundTexture:
    return ground_texture()


@pytest.mark.parametrize(
    ("x", "y", "z"), [(10552, 10000, 100.0), (11000, 10500, 77.8612), (10100, 9300, 123.3191), (10552, 10200, 116.8567)]
)
def test_published_heights(x, y, z):
    assert heights(x, y) == pytest.approx(z, abs=1e-4)


def test_published_pixels_of_a_ground_point():
    ground = np.array([[11000.0, 10500.0, heights(11000.0, 10500.0)]])
    left, right = projected(ground, PublishedPhoto.LEFT) + 0.5, projected(ground, PublishedPhoto.RIGHT) + 0.5
    assert left[0] == pytest.approx([9322.123, 3488.439], abs=1e-3)
    assert right[0] == pytest.approx([5028.531, 3488.439], abs=1e-3)


def test_published_number_of_grid_points_and_statistics_of_the_surface():
    assert len(grid_points(114.506)) == 45271
    z = grid_points(114.506, spacing=1.0)[:, 2]
    assert (z.min(), z.max(), z.mean(), z.std()) == pytest.approx((42.08, 148.38, 99.13, 17.41), abs=5e-3)


@given(st.integers(4600, SIDE - 1), st.integers(300, SIDE - 300))
@settings(max_examples=60, deadline=None)
def test_rays_surface_and_intersection_close(col, row):
    pixel = np.array([[col, row]], dtype=np.float64)
    ground = surface_points(pixel, PublishedPhoto.LEFT)
    assert heights(ground[:, 0], ground[:, 1]) == pytest.approx(ground[:, 2], abs=1e-8)
    assert projected(ground, PublishedPhoto.LEFT) == pytest.approx(pixel, abs=1e-8)
    assert intersected(pixel, true_matches(pixel)) == pytest.approx(ground, abs=1e-6)


def test_intersection_is_the_least_squares_one():
    left, right = np.array([[7000.0, 3000.0]]), np.array([[2700.0, 3001.0]])
    ground = intersected(left, right)

    def squares(point):
        return sum(
            ((projected(point, photo) - seen) ** 2).sum()
            for photo, seen in ((PublishedPhoto.LEFT, left), (PublishedPhoto.RIGHT, right))
        )

    for axis in range(3):
        for step in (-0.01, 0.01):
            moved = ground.copy()
            moved[0, axis] += step
            assert squares(moved) > squares(ground)


@pytest.mark.parametrize("radiometry", [CLEAN, NOISY], ids=["clean", "noise"])
@pytest.mark.parametrize("photo", list(PublishedPhoto))
def test_windows_fit_together_without_a_seam(texture, photo, radiometry):
    whole = rendered(texture, photo, WINDOW, radiometry)
    assert whole.std() > 5
    for part in (Window(5200, 6000, 33, 130), Window(5233, 6007, 57, 19), Window(5289, 6129, 1, 1)):
        at = (
            slice(part.row - WINDOW.row, part.row - WINDOW.row + part.height),
            slice(part.col - WINDOW.col, part.col - WINDOW.col + part.width),
        )
        assert np.array_equal(rendered(texture, photo, part, radiometry), whole[at])


def test_a_pixel_shows_the_texture_at_its_ground_point(texture):
    pixels = np.array([[6003.0, 5207.0], [6111.0, 5288.0]])
    ground = surface_points(pixels, PublishedPhoto.RIGHT)
    place = np.column_stack([(ground[:, 0] - TEXTURE_WEST), (TEXTURE_NORTH - ground[:, 1])]) / TEXTURE_CELL - 0.5
    expected = np.clip(np.rint(sample_cubic(texture.pixels, place)), 1, 255)
    image = rendered(texture, PublishedPhoto.RIGHT, WINDOW)
    assert [image[int(r) - WINDOW.row, int(c) - WINDOW.col] for c, r in pixels] == expected.tolist()


def test_noise_version_has_the_published_noise_gain_and_offset(texture):
    clean, noisy = (rendered(texture, PublishedPhoto.RIGHT, WINDOW, radiometry).astype(float) for radiometry in (CLEAN, NOISY))
    difference = noisy - (0.9 * clean + 10.0)
    assert difference.mean() == pytest.approx(0.0, abs=0.1)
    assert difference.std() == pytest.approx(2.0, rel=0.05)
    left = [rendered(texture, PublishedPhoto.LEFT, WINDOW, radiometry).astype(float) for radiometry in (CLEAN, NOISY)]
    assert np.corrcoef((left[1] - left[0]).ravel(), difference.ravel())[0, 1] == pytest.approx(0.0, abs=0.05)


def test_beyond_texture_and_frame_is_no_data(texture):
    assert not rendered(texture, PublishedPhoto.LEFT, Window(5000, 0, 8, 8)).any()
    beyond = rendered(texture, PublishedPhoto.RIGHT, Window(SIDE - 4, 5000, 8, 8))
    assert not beyond[4:].any()
    assert rendered(texture, PublishedPhoto.LEFT, Window(5000, SIDE - 8, 8, 8)).all()


def test_crop_shows_the_same_ground_in_both_images(texture):
    crop = pair_crop(texture, WINDOW, margin=20)
    right = true_matches(np.array([[c, r] for c in (6000.0, 6129.0) for r in (5200.0, 5289.0)])) - crop.right_origin
    assert (right >= 20).all() and (right <= np.array(crop.right.shape[::-1]) - 21).all()
    assert crop.right.shape[1] < WINDOW.width + 90


def test_check_points_keep_away_from_the_end_of_the_texture():
    points = check_points(110.4, 26)
    assert len(points) == 39443
    ground = surface_points(points, PublishedPhoto.LEFT)
    assert ground[:, 1].max() < TEXTURE_NORTH - 26 * 0.254
    assert np.array_equal(points, np.rint(points))


def test_mirroring_doubles_the_edge_and_covers_any_shape():
    pixels = np.arange(6, dtype=np.uint8).reshape(2, 3)
    assert mirrored(pixels, (5, 7)).tolist() == [
        [0, 1, 2, 2, 1, 0, 0],
        [3, 4, 5, 5, 4, 3, 3],
        [3, 4, 5, 5, 4, 3, 3],
        [0, 1, 2, 2, 1, 0, 0],
        [0, 1, 2, 2, 1, 0, 0],
    ]
    assert np.array_equal(mirrored(pixels, (1, 2)), pixels[:1, :2])


def test_the_shipped_texture_covers_the_ground_of_the_experiment(texture):
    assert texture.pixels.shape == TEXTURE_SHAPE


def test_a_texture_that_is_no_image_is_refused(tmp_path):
    path = tmp_path / "texture.jpg"
    path.write_text("no image")
    with pytest.raises(ResourceError, match=r"texture\.jpg"):
        ground_texture(path)
