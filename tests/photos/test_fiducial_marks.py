"""The affine transformation to fiducial marks against closed forms, and the limits of what redundancy can show."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo
from orthomill.schemas.raster import Window
from orthomill.tasks.photos.fiducials import fit_marks
from orthomill.tasks.photos.scans import in_principal_frame, scan_tile, scan_window, to_file

CORNERS = {"1": (-100.0, 100.0), "2": (100.0, 100.0), "3": (100.0, -100.0), "4": (-100.0, -100.0)}
SIDES = {"5": (-110.0, 0.0), "6": (110.0, 0.0), "7": (0.0, 110.0), "8": (0.0, -110.0)}


def measured(marks, affine, shift=(7000.0, 7000.0)):
    """Pixels of marks (mm) under a known linear map to the scan, rows counted downwards."""
    return {name: np.array(shift) + np.array(xy) @ np.asarray(affine).T * [1.0, -1.0] for name, xy in marks.items()}


def arrays(marks):
    return {name: np.array(xy) for name, xy in marks.items()}


@settings(max_examples=40, deadline=None)
@given(turn=st.floats(-3.1, 3.1), scale=st.floats(20.0, 100.0), shear=st.floats(-0.01, 0.01))
def test_an_exact_affine_image_is_recovered_exactly(turn, scale, shear):
    affine = (
        scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ np.array([[1.0, shear], [0.0, 1.001]])
    )
    fit = fit_marks("a", measured(CORNERS, affine), arrays(CORNERS))
    assert fit.marks == 4 and fit.wrong == {} and not fit.mirrored
    assert fit.rms_um == pytest.approx(0.0, abs=1e-5)
    place = measured({"x": (33.0, -71.0)}, affine)["x"]
    assert np.array([1.0, *place]) @ fit.affine == pytest.approx([33.0, -71.0], abs=1e-8)
    assert np.prod(fit.pixel_um) >= 1e6 / abs(np.linalg.det(affine)) * (1 - 1e-9), "sides of a cell span at least its area"


def test_three_marks_have_no_residual_and_no_standard_error():
    three = {name: CORNERS[name] for name in "123"}
    fit = fit_marks("a", measured(three, 50.0 * np.eye(2)), arrays(CORNERS))
    assert fit.rms_um is None and fit.sigma_um is None and fit.marks == 3
    assert fit.pixel_um == pytest.approx((20.0, 20.0))


def test_four_marks_of_a_square_share_a_gross_error_equally():
    """The affine residual of a square is (+d, -d, +d, -d)/4: with d = 40 px of 20 micrometres and redundancy 2, sigma is 283."""
    places = measured(CORNERS, 50.0 * np.eye(2))
    places["1"] = places["1"] + [40.0, 0.0]
    fit = fit_marks("a", places, arrays(CORNERS))
    assert fit.wrong == {}
    assert fit.rms_um == pytest.approx(np.sqrt(4 * (40.0 * 20.0 / 4) ** 2 / 2), rel=0.02)


@pytest.mark.parametrize("count", [1, 2])
def test_gross_errors_among_eight_marks_are_located_whichever_they_are(count):
    rng = np.random.default_rng(count)
    every = CORNERS | SIDES
    for _ in range(12):
        places = {name: at + rng.normal(0, 0.2, 2) for name, at in measured(every, 50.0 * np.eye(2)).items()}
        bad = rng.permutation(list(every))[:count].tolist()
        for name in bad:
            angle = rng.uniform(0, 2 * np.pi)
            places[name] = places[name] + 60.0 * np.array([np.cos(angle), np.sin(angle)])
        fit = fit_marks("a", places, arrays(every))
        assert set(fit.wrong) == set(bad) and fit.marks == 8 - count
        assert fit.rms_um is not None and fit.rms_um < 10.0


def test_errors_below_a_pixel_reject_no_mark():
    places = {
        name: at + np.random.default_rng(3).normal(0, 0.3, 2) for name, at in measured(CORNERS | SIDES, 50.0 * np.eye(2)).items()
    }
    assert fit_marks("a", places, arrays(CORNERS | SIDES)).wrong == {}


def test_the_coordinate_is_best_in_the_middle():
    places = {name: at + np.random.default_rng(4).normal(0, 0.3, 2) for name, at in measured(CORNERS, 50.0 * np.eye(2)).items()}
    fit = fit_marks("a", places, arrays(CORNERS))
    middle, outermost = fit.sigma_um
    # n = 4 marks at the corners: cofactor 1/4 in the middle, 1/4 + 1/4 + 1/4 at a corner.
    assert middle == pytest.approx(fit.rms_um / 2, rel=1e-2) and outermost / middle == pytest.approx(np.sqrt(3.0), rel=1e-2)


def test_marks_on_one_line_are_refused():
    line = {name: (10.0 * number, 10.0 * number) for number, name in enumerate("abc")}
    with pytest.raises(WorkflowError, match="marks of p lie on one line; measure at least one mark off this line"):
        fit_marks("p", measured(line, 50.0 * np.eye(2)), arrays(line))


def scan(width=80, height=60):
    return Photo(name="a", path="a.tif", width=width, height=height, bands=1, dtype="uint8", camera="c")


def shifted(**more):
    (fitted,) = in_principal_frame([scan(**more)], "# lines across the marks\n\nphoto,col,row\na,39.5,29.5\n", None)
    return fitted.photo


def test_comments_and_blank_lines_of_the_file_are_skipped_and_the_scan_is_whole():
    photo = shifted()
    assert (photo.width, photo.height) == (81, 61) and photo.scan_size == (80, 60)
    assert photo.camera == "scan 81 x 61" and photo.pixel_um is None


def test_a_half_pixel_shift_of_a_ramp_is_exact():
    photo, window = shifted(), Window(8, 8, 40, 50)
    pixels = (20 + 2 * np.arange(80)[None, :] + 0 * np.arange(60)[:, None]).astype(np.uint8)[:, :, None]
    source = scan_window(photo, window)
    tile = scan_tile(photo, window, source, pixels[source.slices])
    place = to_file(photo, np.column_stack([np.arange(8.0, 58.0), np.full(50, 20.0)]))
    assert np.allclose(place[:, 0], np.arange(8.0, 58.0) - 0.5)
    assert np.array_equal(tile[12, :, 0], (20 + 2 * place[:, 0]).astype(np.uint8))


def test_tiles_beyond_the_scan_are_black():
    window = Window(0, 0, 16, 16)
    assert not scan_tile(shifted(), window, Window(0, 0, 0, 0)).any()
    photo = shifted()
    far = Window(1000, 1000, 16, 16)
    assert scan_window(photo, far).empty


def test_any_tiling_gives_the_same_pixels():
    photo = shifted()
    pixels = np.random.default_rng(6).integers(0, 256, (60, 80, 1), dtype=np.uint8)

    def tile(window):
        source = scan_window(photo, window)
        return scan_tile(photo, window, source, pixels[source.slices])

    whole = tile(Window(0, 0, 61, 81))
    for part in (Window(0, 0, 17, 33), Window(17, 33, 30, 48), Window(47, 5, 14, 1)):
        assert np.array_equal(tile(part), whole[part.slices])
