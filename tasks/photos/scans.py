"""Scanned film photographs: from pixels of the scan to image coordinates, and the frame that all scans of a camera share.

The camera had fiducial marks with calibrated image coordinates (mm). An affine transformation from the scan to the marks removes
the position of the film on the scanner and its linear deformation. Where only the principal pixel is known, the intersection of
the lines between opposite marks, scans are shifted. In either case every photograph is resampled once, to a frame with square
pixels whose middle is the origin of the image coordinates; all later stages work as with a digital camera, and one interior
orientation serves all photographs.

Source: Karfis 2009, sections 1.3 and 5.2 (sources/epipolar.md#option-a, #option-b).
"""

import csv
import io
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo
from orthomill.schemas.raster import Window
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.tasks.imagery.masked_pixels import with_mask
from orthomill.tasks.imagery.resampling import sample_cubic
from orthomill.tasks.photos.fiducials import fit_marks

# A frame whose pixels are this many times coarser or finer than those of the scan comes from a wrong unit: mistaken units (mm for
# micrometres, dpi for micrometres) differ by more, sensible reductions by less.
_MOST_SCALE = 4.0
_REACH = 3  # px around a window: two for the cubic kernel, one for rounding
_PICTURE_TOLERANCE = 1.05  # marks may lie inside the exposed picture, so it may exceed their extent a little


class Scan(BaseModel):
    """The transformation from the scan of a photograph to its marks."""

    model_config = ConfigDict(frozen=True)

    photo: str
    marks: int
    rms_um: float | None
    """standard error of a mark; None with three marks, which fit exactly, or with a principal pixel"""
    sigma_um: tuple[float, float] | None = None
    """standard errors of a transformed coordinate, in the middle and at the outermost mark"""
    turn_deg: float
    col_um: float | None
    row_um: float | None
    """size of a pixel of the scan along its columns and rows"""
    wrong: dict[str, float] = {}
    """rejected marks: distance from where the others place them, px of the scan"""
    mirrored: bool = False


class Scans(BaseModel):
    """All scans of a project; empty for digital photographs. `cut`: whether they were cut to the exposed picture."""

    model_config = ConfigDict(frozen=True)

    scans: tuple[Scan, ...] = ()
    cut: bool = False


@dataclass(frozen=True)
class Fitted:
    """A photograph in the common frame, and the transformation of its scan."""

    photo: Photo
    scan: Scan


def in_mark_frame(
    photos: list[Photo], marks_text: str, measured_text: str, pixel_um: float, picture_mm: tuple[float, float] | None = None
) -> list[Fitted]:
    """Every photograph in the frame of its fiducial marks, with pixels of `pixel_um`.

    picture_mm: width and height to which it is cut; without it the frame reaches to the outermost marks. Raises WorkflowError.
    """
    marks = {row["mark"]: _xy(row, ("x", "y")) for row in _rows(marks_text, ("mark", "x", "y"), "fiducial marks")}
    measured = _measured_marks(measured_text, marks)
    few = [photo.name for photo in photos if len(measured.get(photo.name, {})) < 3]
    if few:
        raise WorkflowError(f"{', '.join(few[:8])}: fewer than three fiducial marks are measured, but three are needed.")
    # One half size for all photographs: frames of equal size with a common origin are what lets them share a camera.
    reach = np.abs(np.array(list(marks.values()))).max(axis=0)
    half = np.ceil(1000.0 * reach / pixel_um).astype(int)
    if picture_mm is not None:
        half = _half_of(picture_mm, pixel_um, 2.0 * reach)
    return [_by_marks(photo, marks, measured[photo.name], pixel_um, half) for photo in photos]


def _measured_marks(text: str, marks: dict[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """Photograph -> mark -> (col, row) of the scan. Raises WorkflowError for unknown marks and repeated lines."""
    measured: dict[str, dict[str, np.ndarray]] = {}
    for row in _rows(text, ("photo", "mark", "col", "row"), "mark measurements"):
        if row["mark"] not in marks:
            raise WorkflowError(f"The mark {row['mark']} is measured in {row['photo']}, but has no calibrated coordinates.")
        of_photo = measured.setdefault(photo_stem(row["photo"]), {})
        if row["mark"] in of_photo:
            raise WorkflowError(f"The mark {row['mark']} is measured twice in {row['photo']}; keep one of the two lines.")
        of_photo[row["mark"]] = _xy(row, ("col", "row"))
    return measured


def _by_marks(photo: Photo, marks: dict[str, np.ndarray], own: dict[str, np.ndarray], pixel_um: float, half: np.ndarray) -> Fitted:
    fit = fit_marks(photo.name, own, marks)
    col_um, row_um = fit.pixel_um
    if not 1.0 / _MOST_SCALE < np.sqrt(col_um * row_um) / pixel_um < _MOST_SCALE:
        raise WorkflowError(
            f"By its fiducial marks a pixel of the scan {photo.name} is {np.sqrt(col_um * row_um):.4g} micrometres, but pixel_um "
            f"is {pixel_um:g}; calibrated marks are in millimetres, their measurements in pixels, pixel_um in micrometres."
        )
    along_col = fit.affine[1]
    scan = Scan(
        photo=photo.name,
        marks=fit.marks,
        rms_um=fit.rms_um,
        sigma_um=fit.sigma_um,
        turn_deg=float(np.degrees(np.arctan2(along_col[1], along_col[0]))),
        col_um=col_um,
        row_um=row_um,
        wrong=fit.wrong,
        mirrored=fit.mirrored,
    )
    # Image coordinates have y up, rows count downwards; the origin of the marks becomes the middle pixel of the frame.
    to_frame = 1000.0 / pixel_um * fit.affine * [1.0, -1.0]
    to_frame[0] += half
    return Fitted(_framed(photo, to_frame, half, pixel_um), scan)


def _half_of(picture_mm: tuple[float, float], pixel_um: float | None, largest_mm: np.ndarray) -> np.ndarray:
    """Half the size (2,), px, of the frame that the exposed picture fills. Raises WorkflowError."""
    if pixel_um is None:
        raise WorkflowError("picture_mm is in millimetres: give pixel_um as well, the side of a pixel of the scan.")
    if not (min(picture_mm) > 0.0 and (np.array(picture_mm) <= _PICTURE_TOLERANCE * largest_mm).all()):
        raise WorkflowError(
            f"picture_mm is {picture_mm[0]:g} x {picture_mm[1]:g} mm, but the scans reach {largest_mm[0]:.4g} x "
            f"{largest_mm[1]:.4g} mm; give the width and height of the exposed picture in millimetres."
        )
    # Rounded inwards, so that no pixel of the film's margin enters.
    return np.floor(500.0 * np.array(picture_mm) / pixel_um - 0.5).astype(int)


def in_principal_frame(
    photos: list[Photo], measured_text: str, pixel_um: float | None, picture_mm: tuple[float, float] | None = None
) -> list[Fitted]:
    """Every photograph shifted so that its principal pixel is the middle of the frame.

    picture_mm: as in `in_mark_frame`; without it the frame holds every scan completely. Raises WorkflowError.
    """
    rows = _rows(measured_text, ("photo", "col", "row"), "principal pixels")
    principal = {photo_stem(row["photo"]): _xy(row, ("col", "row")) for row in rows}
    missing = [photo.name for photo in photos if photo.name not in principal]
    if missing:
        raise WorkflowError(f"The file of principal pixels does not name {', '.join(missing[:8])}.")
    sizes = np.array([(photo.width, photo.height) for photo in photos])
    places = np.array([principal[photo.name] for photo in photos])
    half = np.ceil(np.maximum(places, sizes - 1 - places).max(axis=0)).astype(int)
    if picture_mm is not None:
        half = _half_of(picture_mm, pixel_um, 2.0 * half * (pixel_um or 0.0) / 1000.0)
    found = []
    for photo, place in zip(photos, places, strict=True):
        to_frame = np.array([half - place, [1.0, 0.0], [0.0, 1.0]])
        scan = Scan(photo=photo.name, marks=0, rms_um=None, turn_deg=0.0, col_um=pixel_um, row_um=pixel_um)
        found.append(Fitted(_framed(photo, to_frame, half, pixel_um), scan))
    return found


def _framed(photo: Photo, to_frame: np.ndarray, half: np.ndarray, pixel_um: float | None) -> Photo:
    """`to_frame` (3, 2): rows for 1, col and row of the file, columns for col and row of the frame."""
    # An odd size has a pixel in its middle: the origin of the image coordinates lies on it exactly.
    width, height = (2 * half + 1).tolist()
    coefficients = tuple(float(v) for v in to_frame.T.ravel())
    # Tags of a scanner say nothing about the camera: equal frames are taken for one camera, whatever the files claim.
    camera = f"scan {width} x {height}"
    changes = {"width": width, "height": height, "scan": coefficients, "scan_size": (photo.width, photo.height), "camera": camera}
    return photo.model_copy(update={**changes, "pixel_um": pixel_um or photo.pixel_um})


def _rows(text: str, columns: tuple[str, ...], what: str) -> list[dict[str, str]]:
    """The rows of a CSV file as text by column, without blank lines and comments. Raises WorkflowError for missing columns."""
    lines = [line for line in text.lstrip("\ufeff").splitlines() if line.strip() and not line.startswith("#")]
    reader = csv.DictReader(io.StringIO("\n".join(lines)), skipinitialspace=True)
    missing = [name for name in columns if name not in (reader.fieldnames or ())]
    if missing:
        raise WorkflowError(
            f"The file of {what} has no column {', '.join(missing)}; its first line must name {', '.join(columns)}."
        )
    return [{name: (value or "").strip() for name, value in row.items() if name} for row in reader]


def _xy(row: dict[str, str], names: tuple[str, str]) -> np.ndarray:
    try:
        return np.array([float(row[name]) for name in names])
    except ValueError:
        raise WorkflowError(f"'{row[names[0]]}, {row[names[1]]}' must be two numbers ({', '.join(names)}): {row}.") from None


def to_file(photo: Photo, pixels: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) (col, row) of the scan that correspond to pixels (N, 2) of the frame."""
    s = np.array(photo.scan).reshape(2, 3)
    return (pixels - s[:, 0]) @ np.linalg.inv(s[:, 1:]).T


def scan_window(photo: Photo, window: Window) -> Window:
    """The window of the scan that a window of the frame needs; empty where the scan does not reach."""
    cols, rows = (window.col, window.col + window.width - 1), (window.row, window.row + window.height - 1)
    # An affine image of a rectangle is the convex hull of its four corners.
    places = to_file(photo, np.array([(col, row) for col in cols for row in rows], dtype=float))
    low, high = np.floor(places.min(axis=0)).astype(int) - _REACH, np.ceil(places.max(axis=0)).astype(int) + _REACH
    width, height = photo.scan_size or (photo.width, photo.height)
    return Window(int(low[1]), int(low[0]), int(high[1] - low[1] + 1), int(high[0] - low[0] + 1)).clipped((height, width))


def scan_tile(
    photo: Photo, window: Window, source: Window, pixels: np.ndarray | None = None, mask: np.ndarray | None = None
) -> np.ndarray:
    """A window of the frame from `source` of the scan, and of its mask: (rows, cols, bands); 0 where the scan does not reach."""
    shape = (window.height, window.width, photo.stored_bands)
    if pixels is None:
        return np.zeros(shape, photo.dtype)
    pixels = pixels if mask is None else with_mask(pixels, mask)
    row, col = np.mgrid[window.row : window.row + window.height, window.col : window.col + window.width]
    places = to_file(photo, np.column_stack([col.ravel(), row.ravel()]).astype(float)) - [source.col, source.row]
    # float64, so that the sum over the kernel does not depend on where the tile begins.
    values = sample_cubic(pixels[:, :, : photo.stored_bands].astype(np.float64), places)
    full = np.iinfo(photo.dtype).max
    return np.nan_to_num(np.clip(np.rint(values), 0, full)).reshape(shape).astype(photo.dtype)
