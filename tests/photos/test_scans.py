"""Scans of film: the affine transformation to fiducial marks, the principal pixel, and the pixels of the common frame."""

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.storage.photographs.folder_listing import image_files
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.project import Project
from orthomill.schemas.raster import Window
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.photos.fiducials import fit_marks
from orthomill.tasks.photos.plan.photo_jobs import SCANS
from orthomill.tasks.photos.report.photos_report import photos_report
from orthomill.tasks.photos.scans import Scans, in_mark_frame, in_principal_frame, scan_window, to_file
from orthomill.tasks.photos.stage import PhotosStage

MARKS = {"1": (-9.0, 7.0), "2": (9.0, 7.0), "3": (9.0, -7.0), "4": (-9.0, -7.0)}
PIXEL = 50.0
TURN = np.radians(1.5)


def to_scan(mm, turn=TURN, size=(49.0, 51.0), origin=(200.0, 160.0)):
    """Pixels of a scan whose columns are `size[0]` and rows `size[1]` micrometres, turned on the scanner."""
    x, y = np.asarray(mm, float).T
    u, v = x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)
    return np.column_stack([origin[0] + 1000 * u / size[0], origin[1] - 1000 * v / size[1]])


def texts(noise=0.0, photos=("a",), shift=(0.0, 0.0)):
    rng = np.random.default_rng(3)
    marks = "mark,x,y\n" + "".join(f"{name},{x},{y}\n" for name, (x, y) in MARKS.items())
    rows = [
        f"{photo}.tif,{name},{col},{row}\n"
        for photo in photos
        for name, (col, row) in zip(MARKS, to_scan(list(MARKS.values())) + rng.normal(0, 1, (4, 2)) * noise + shift, strict=True)
    ]
    return marks, "photo,mark,col,row\n" + "".join(rows)


def scan(name="a", width=401, height=331):
    return Photo(name=name, path=f"in/{name}.tif", width=width, height=height, bands=1, dtype="uint8", camera="c")


def test_marks_determine_the_affine_transformation():
    (fitted,) = in_mark_frame([scan()], *texts(), PIXEL)
    photo, lay = fitted.photo, fitted.scan
    assert (photo.width, photo.height) == (361, 281) and photo.pixel_um == PIXEL and photo.scan_size == (401, 331)
    assert lay.marks == 4 and lay.rms_um == pytest.approx(0.0, abs=1e-6)
    assert lay.col_um == pytest.approx(49.0, rel=1e-3) and lay.row_um == pytest.approx(51.0, rel=1e-3)
    assert abs(lay.turn_deg) == pytest.approx(1.5, abs=0.05)
    mm = np.array([[0.0, 0.0], [9.0, 7.0], [-3.2, 1.7]])
    frame = np.column_stack([180 + mm[:, 0] * 1000 / PIXEL, 140 - mm[:, 1] * 1000 / PIXEL])
    assert np.allclose(to_file(photo, frame), to_scan(mm), atol=1e-9)
    for place, pixel in zip(frame, to_scan(mm), strict=True):
        assert photo.from_file(*pixel) == pytest.approx(tuple(place), abs=1e-9), "control is measured in the scan"


def test_scans_are_cut_to_the_picture():
    (whole,), (cut,) = (in_mark_frame([scan()], *texts(), PIXEL, size) for size in (None, (16.0, 12.0)))
    assert (cut.photo.width, cut.photo.height) == (319, 239)
    middle = [to_file(one.photo, np.array([[(one.photo.width - 1) / 2, (one.photo.height - 1) / 2]])) for one in (whole, cut)]
    assert np.allclose(middle[0], middle[1], atol=1e-9), "the origin of the marks is the middle of both"
    with pytest.raises(WorkflowError, match="picture_mm is 160 x 120 mm, but the scans reach 18 x 14 mm"):
        in_mark_frame([scan()], *texts(), PIXEL, (160.0, 120.0))
    with pytest.raises(WorkflowError, match="give pixel_um as well"):
        in_principal_frame([scan()], "photo,col,row\na,200,160\n", None, (16.0, 12.0))


def test_the_precision_of_the_transformation_is_that_of_repeated_measurements():
    rng, places, stated = np.random.default_rng(8), [], []
    for _ in range(300):
        measured = {name: xy + rng.normal(0, 0.2, 2) for name, xy in zip(EIGHT, to_scan(list(EIGHT.values())), strict=True)}
        fit = fit_marks("a", measured, {name: np.array(xy) for name, xy in EIGHT.items()})
        places.append([np.array([1.0, *to_scan([at])[0]]) @ fit.affine for at in ((0.0, 0.0), (9.0, 7.0))])
        stated.append(fit.sigma_um)
    scatter = 1000.0 * np.std(places, axis=0).mean(axis=1)
    assert np.allclose(np.sqrt(np.mean(np.square(stated), axis=0)), scatter, rtol=0.1)


def test_residuals_at_the_marks_show_their_quality():
    (fitted,) = in_mark_frame([scan()], *texts(noise=0.5), PIXEL)
    assert 3.0 < fitted.scan.rms_um < 80.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda marks, rows: (marks, "\n".join(rows.splitlines()[:3])), "a: fewer than three fiducial marks"),
        (lambda marks, rows: (marks, rows.replace(",4,", ",9,")), "mark 9 is measured in a.tif, but has no calibrated"),
        (lambda marks, rows: (marks.replace("x,y", "x,z"), rows), "no column y"),
        (lambda marks, rows: (marks, rows.replace("a.tif,4,", "a.tif,4,x")), "must be two numbers"),
        (lambda marks, rows: (marks, rows + rows.splitlines()[-1] + "\n"), "mark 4 is measured twice in a.tif"),
        (lambda marks, rows: (marks.replace(".0", "000"), rows), "pixel of the scan a is .* but pixel_um is 50"),
    ],
)
def test_missing_marks_are_reported(change, sentence):
    with pytest.raises(WorkflowError, match=sentence):
        in_mark_frame([scan()], *change(*texts()), PIXEL)


EIGHT = MARKS | {"5": (-9.0, 0.0), "6": (9.0, 0.0), "7": (0.0, 7.0), "8": (0.0, -7.0)}


def eight_marks(change):
    """The scan `a` with eight marks, their measurements (8, 2) changed by `change`."""
    noise = 0.1 * np.random.default_rng(5).normal(size=(8, 2))
    places = change(to_scan(list(EIGHT.values())) + noise)
    marks = "mark,x,y\n" + "".join(f"{name},{x},{y}\n" for name, (x, y) in EIGHT.items())
    rows = "".join(f"a,{name},{col},{row}\n" for name, (col, row) in zip(EIGHT, places, strict=True))
    return in_mark_frame([scan()], marks, "photo,mark,col,row\n" + rows, PIXEL)[0]


def test_a_wrong_mark_among_many_is_named_and_rejected():
    def one_wrong(places):
        places[4] += [30.0, -20.0]
        return places

    fitted = eight_marks(one_wrong)
    assert fitted.scan.wrong == {"5": pytest.approx(np.hypot(30, 20), abs=1.0)} and fitted.scan.marks == 7
    assert np.abs(to_file(fitted.photo, np.array([[180.0, 140.0]])) - to_scan([(0.0, 0.0)])).max() < 0.2
    (said,) = photos_report(Photos(photos=()), Scans(scans=(fitted.scan,), cut=True), (), "none").warnings
    assert "mark 5 of a lies 36" in said


def test_exchanged_marks_are_both_found():
    fitted = eight_marks(lambda places: places[[0, 1, 2, 3, 5, 4, 6, 7]])
    assert set(fitted.scan.wrong) == {"5", "6"}


def test_one_of_four_marks_is_wrong_but_has_no_name():
    marks, rows = texts()
    first = rows.splitlines()[1].split(",")
    shifted = rows.replace(",".join(first), f"{first[0]},{first[1]},{float(first[2]) + 40},{first[3]}")
    (fitted,) = in_mark_frame([scan()], marks, shifted, PIXEL)
    (said,) = photos_report(Photos(photos=()), Scans(scans=(fitted.scan,), cut=True), (), "none").warnings
    assert fitted.scan.wrong == {} and said.startswith("The fiducial marks of a (")


def test_marks_counted_downwards_are_reported():
    marks, rows = texts()
    down = "mark,x,y\n" + "".join(f"{name},{x},{-y}\n" for name, (x, y) in MARKS.items())
    (fitted,) = in_mark_frame([scan()], down, rows, PIXEL)
    (said,) = photos_report(Photos(photos=()), Scans(scans=(fitted.scan,), cut=True), (), "none").warnings
    assert "1 photograph (a) mirrored" in said and not in_mark_frame([scan()], marks, rows, PIXEL)[0].scan.mirrored


def test_principal_pixels_shift_scans_to_a_common_middle():
    text = "photo,col,row\na,200.25,160\nb.tif,190,170\n"
    a, b = in_principal_frame([scan("a"), scan("b")], text, None)
    assert (a.photo.width, a.photo.height) == (b.photo.width, b.photo.height) == (2 * 210 + 1, 2 * 170 + 1)
    assert a.photo.camera == b.photo.camera
    assert np.allclose(to_file(a.photo, np.array([[210.0, 170.0]])), [[200.25, 160.0]])
    with pytest.raises(WorkflowError, match="does not name b"):
        in_principal_frame([scan("a"), scan("b")], "photo,col,row\na,1,2\n", None)


def test_a_window_needs_only_its_part_of_the_scan():
    (fitted,) = in_mark_frame([scan()], *texts(), PIXEL)
    part = scan_window(fitted.photo, Window(0, 0, 64, 64))
    assert part.width < 90 and part.height < 90
    (far,) = in_mark_frame([scan(width=100, height=100)], *texts(), PIXEL)
    assert scan_window(far.photo, Window(256, 320, 16, 16)).empty


def surface(x, y):
    """A smooth picture over image coordinates in mm."""
    return 128 + 60 * np.sin(1.1 * x) * np.cos(0.8 * y) + 30 * np.sin(0.5 * x + 1.3 * y)


@pytest.mark.parametrize("tile", [128, 512])
def test_the_stage_resamples_scans_to_the_frame(tmp_path, tile):
    (tmp_path / "in").mkdir()
    col, row = np.meshgrid(np.arange(401.0), np.arange(331.0))
    u, v = (col - 200) * 0.049, (160 - row) * 0.051
    x, y = u * np.cos(TURN) + v * np.sin(TURN), -u * np.sin(TURN) + v * np.cos(TURN)
    for name in "ab":
        Image.fromarray(np.rint(surface(x, y)).astype(np.uint8)).save(tmp_path / "in" / f"{name}.tif")
    marks, rows = texts(photos=("a", "b"))
    (tmp_path / "marks.csv").write_text(marks)
    (tmp_path / "measured.csv").write_text(rows)
    project = Project.model_validate(
        {
            "project": "p",
            "crs": "EPSG:2100",
            "photographs": {"kind": "folder", "path": "in"},
            "positions": {"kind": "none"},
            "tile": tile,
        }
    )
    coordinates = {"kind": "fiducial_marks", "marks_path": "marks.csv", "measured_path": "measured.csv", "pixel_um": PIXEL}
    session = Session(project, (PhotosStage(coordinates=coordinates),), tmp_path, lambda source: image_files(tmp_path, source))
    session.run(SequentialRunner(2**30), _Silence())
    photo = session.store.table(PHOTOS).photos[0]
    found = session.store.read(photo_raster("a"), Window(0, 0, photo.height, photo.width))[:, :, 0].astype(float)
    frame_col, frame_row = np.meshgrid(np.arange(361.0), np.arange(281.0))
    truth = surface((frame_col - 180) * PIXEL / 1000, (140 - frame_row) * PIXEL / 1000)
    assert np.abs(found - truth).max() < 1.6
    assert [one.marks for one in session.store.table(SCANS).scans] == [4, 4]
    assert any(grid.title == "Scans" for grid in session.store.table(report_table("photos")).grids)
    assert gaussian_filter(found - truth, 5).std() < 0.1, "no shift by a part of a pixel"


class _Silence:
    def planned(self, key): ...

    def skipped(self, key): ...

    def finished(self, finished, seconds): ...
