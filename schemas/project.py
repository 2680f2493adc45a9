"""The project part of a workflow file: photographs, cameras, positions, ground control.

The stages part is typed by the catalogue of stages; the pipeline combines the two.
"""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from orthomill.schemas.accuracy.acceptance import Acceptance, NoAcceptance
from orthomill.schemas.camera import INTERIOR, LENSES, Lens, LensKind, lens_parameters
from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting

ANY_CRS = "EPSG:3857"
"""For what lies nowhere on the earth, such as boards or an object without positions: a project needs a system in metres."""


MASKS = (
    "Folder with masks, images of the size of the photographs and named like them (IMG_1.png, IMG_1_mask.png or IMG_1.JPG.png): "
    "what is black is not used by any stage. A photograph without a mask is used whole."
)


class PhotoFolder(Settings):
    """All JPEG, TIFF and PNG images of a folder (HEIC and raw ones with the extra `formats`)."""

    kind: Literal["folder"]
    path: str = setting(..., "Folder with the photographs, relative to the project's root.")
    folders: Literal["none", "card", "all"] = setting(
        "none", "Which folders below it are looked into: none; those that cameras make on cards (DCIM, 100MEDIA, ...); or all."
    )
    pattern: str = setting("*", "Only files whose name matches this shell pattern.")
    band: str | None = setting(
        None,
        "Of a multispectral camera, the band that makes the block, by its name, or colour; without it, colour or the band nearest "
        "to green.",
    )
    masks: str | None = setting(None, MASKS)


class PhotoList(Settings):
    """Photographs named one by one."""

    kind: Literal["list"]
    paths: tuple[str, ...] = setting(..., "The image files, relative to the project's root.", min_length=1)
    masks: str | None = setting(None, MASKS)


class SimulatedPhotos(Settings):
    """Photographs of a simulated scene with known truth, rendered by the stage `simulation`."""

    kind: Literal["simulated"]


class MaskFiles(Settings):
    """The masks in a folder, which may be that of the photographs."""

    kind: Literal["masks"] = "masks"
    path: str = setting(..., "Folder with the masks, relative to the project's root.")


PhotoFiles = PhotoFolder | PhotoList
"""Photographs that exist as files before anything runs."""

Photographs = Annotated[PhotoFolder | PhotoList | SimulatedPhotos, Field(discriminator="kind")]

# One camera source per project: a second camera is the exception, and its photographs fall back to their EXIF tags.
# Photographs are thrown out all the time, blurred ones first, and the control file is rarely edited along.
ABSENT = (
    "What happens to measurements in photographs that the project does not have: they are skipped, with a warning, or the file is "
    "refused."
)
SERVES = "Shell pattern of the names of the photographs taken with this camera; others have the camera of their EXIF tags."


class CameraFromExif(Settings):
    """The camera constant from the EXIF tags: nominal, refined by the block adjustment."""

    kind: Literal["exif"]


class CameraFromFile(Settings):
    """A camera file written by an earlier calibration (camera.json)."""

    kind: Literal["file"]
    path: ProjectPath = setting(..., "The camera file, relative to the project's root.")
    serves: str = setting("*", SERVES)


class StatedLens(Settings):
    """Model of a lens and its coefficients."""

    lens: LensKind = setting("brown", "Model of the lens that the coefficients belong to; with OpenCV's numbers.")
    k1: float = setting(0.0, "Radial distortion, second order; radius in units of c, as in OpenCV (fisheye: of the angle).")
    k2: float = setting(0.0, "Radial distortion, fourth order.")
    k3: float = setting(0.0, "Radial distortion, sixth order.")
    p1: float = setting(0.0, "Tangential distortion.")
    p2: float = setting(0.0, "Tangential distortion.")
    k4: float = setting(0.0, "Rational: second order of the denominator; fisheye: eighth order.")
    k5: float = setting(0.0, "Rational: fourth order of the denominator.")
    k6: float = setting(0.0, "Rational: sixth order of the denominator.")
    s1: float = setting(0.0, "Thin prism, second order, along x.")
    s2: float = setting(0.0, "Thin prism, fourth order, along x.")
    s3: float = setting(0.0, "Thin prism, second order, along y.")
    s4: float = setting(0.0, "Thin prism, fourth order, along y.")

    @model_validator(mode="after")
    def _coefficients_of_the_lens(self) -> "StatedLens":
        """A coefficient that the lens lacks would be passed over without a word."""
        own = lens_parameters(self.lens)
        stated = [name for name in INTERIOR if name in StatedLens.model_fields and getattr(self, name)]
        if strange := [name for name in stated if name not in own]:
            raise ValueError(f"a lens of kind {self.lens} has no {', '.join(strange)}; it has {', '.join(own)}")
        return self

    @property
    def lens_model(self) -> Lens:
        """The lens with its coefficients."""
        kind = LENSES[self.lens]
        return kind(**{name: getattr(self, name) for name in kind.model_fields if name != "kind"})


class CameraGiven(StatedLens):
    """Interior orientation given in the workflow."""

    kind: Literal["given"]
    c: float = setting(..., "Camera constant.", "px", gt=0)
    x0: float = setting(0.0, "Principal point, right of the image centre.", "px")
    y0: float = setting(0.0, "Principal point, above the image centre.", "px")
    affinity: float = setting(0.0, "fx / fy - 1: c is the camera constant along y, c (1 + affinity) that along x.", gt=-0.9, lt=9.0)
    skew: float = setting(0.0, "Shear of x by y, in units of c; 0 for perpendicular axes.")
    pixel_um: float | None = setting(None, "Side of a pixel on the sensor or scan.", "micrometres", gt=0)
    # 0 stores no covariance at all, because a variance of zero would claim an error-free camera constant.
    sigma_c: float = setting(0.0, "Standard error of the camera constant; 0 when not known.", "px", ge=0)
    serves: str = setting("*", SERVES)


class CameraFromChessboards(Settings):
    """Calibration from photographs of one chessboard, or of several equal ones that are not moved."""

    kind: Literal["chessboards"]
    photographs: Photographs = setting(..., "Photographs of the chessboards, taken with the same camera and focus.")
    corners: tuple[int, int] = setting(
        ..., "Inner corners of a board: columns, rows. One even and one odd number give a first corner; other boards serve, too."
    )
    # Scales the boards and cameras of the calibration only: the interior orientation in pixels does not depend on it while the
    # boards are exact.
    square: float = setting(..., "Side of a square.", "m", gt=0)
    boards: int = setting(0, "Number of equal boards in the scene; 0: as many as the photographs show.", ge=0, le=40)
    arrangement: Literal["plane", "space"] = setting(
        "plane", "Whether the boards are in one plane, at positions and angles that need not be known, or anywhere in space."
    )
    sigma_in_plane: float = setting(0.0, "Standard error of the corners of a board within its plane; 0: exact.", "m", ge=0)
    sigma_height: float = setting(0.0, "Standard error of the corners of a board out of its plane; 0: flat.", "m", ge=0)
    # Half a percent is a millimetre on a board of A4: paper on cardboard, or a panel that leans. Photographs tell the rest.
    bend: float = setting(
        0.005,
        "Standard error of the bends of a board (how far the middle of a side stands out), in units of its longer side; they are "
        "estimated. 0: flat, as a board of glass.",
        ge=0,
        le=0.1,
    )
    serves: str = setting("*", SERVES)


CameraSource = Annotated[CameraFromExif | CameraFromFile | CameraGiven | CameraFromChessboards, Field(discriminator="kind")]


class PositionsFromExif(Settings):
    """Projection centres from the GPS tags."""

    # What is stated here holds for all photographs, also for those whose tags state more or less.
    kind: Literal["exif"]
    sigma_plan: float | None = setting(
        None, "Standard error in X and Y; by default each photograph's own by its tags (RTK), 3 where they state none.", "m", gt=0
    )
    sigma_height: float | None = setting(
        None, "Standard error in Z; by default each photograph's own by its tags (RTK), 5 where they state none.", "m", gt=0
    )
    crs: str | None = setting(
        None,
        "What the heights of the tags refer to, as a reference system: EPSG:4979 for heights above the ellipsoid, EPSG:4326+5773 "
        "for heights above the sea (EGM96); by default what the tags say, if they do.",
    )


class PositionsFromFile(Settings):
    """Projection centres from a file: columns photo, x, y, z, sigma_x, sigma_y, sigma_z, or what DJI (.MRK), RTKLIB, Emlid,
    REDtoolbox, Pix4D, Metashape, OpenDroneMap (geo.txt) and senseFly write."""

    kind: Literal["file"]
    path: ProjectPath = setting(..., "The file, relative to the project's root.")
    crs: str | None = setting(
        None,
        "Reference system of the positions, e.g. EPSG:4979 (degrees, heights above the ellipsoid) or EPSG:2100+5773; by default "
        "the one that the file names, EPSG:4326 for degrees, or that of the project.",
    )
    # The defaults are those of a consumer receiver without corrections, as for GPS tags.
    sigma_plan: float = setting(3.0, "Standard error in X and Y, where the file states none.", "m", gt=0)
    sigma_height: float = setting(5.0, "Standard error in Z, where the file states none.", "m", gt=0)
    errors_in: Literal["m", "mm"] | None = setting(
        None, "Unit of the standard errors in the file; null: metres, and refused where they can only be millimetres."
    )


class NoPositions(Settings):
    """The positions of the photographs are unknown."""

    kind: Literal["none"]


class SimulatedPositions(Settings):
    """The positions file that the stage `simulation` writes."""

    kind: Literal["simulated"]


Positions = Annotated[PositionsFromExif | PositionsFromFile | NoPositions | SimulatedPositions, Field(discriminator="kind")]


class SurveyedPoints(Settings):
    """What is stated of a list of surveyed points where the file does not."""

    crs: str | None = setting(
        None, "Reference system of the points, e.g. EPSG:4326 or EPSG:2100+5773; by default that of the file, or the project's."
    )
    sigma_plan: float = setting(0.03, "Standard error of the points in X and Y, where the file states none.", "m", gt=0)
    sigma_height: float = setting(0.05, "Standard error of the points in Z, where the file states none.", "m", gt=0)
    errors_in: Literal["m", "mm"] | None = setting(
        None, "Unit of the standard errors of the points; null: metres, and refused where they can only be millimetres."
    )
    check: tuple[str, ...] = setting((), "Names of the points that are check points, where the file has no roles.")


class ControlFromFiles(SurveyedPoints):
    """Ground control and check points from files: our own columns, or what Pix4D, Metashape (CSV, XML), Leica and others write."""

    kind: Literal["files"]
    points: ProjectPath = setting(
        ...,
        "CSV with the columns name, role (control, check or tie), x, y, z, sigma_x, sigma_y, sigma_z; a tie point is measured in "
        "photographs only, and its coordinates are left empty. Or a list of another program: name and coordinates.",
    )
    measurements: ProjectPath | None = setting(
        None,
        "CSV with the columns name, photo, col, row, sigma (pixels), or the marks of Pix4D (photo, name, col, row); null: they are "
        "in the file of the points, as in Metashape's XML.",
    )
    distances: ProjectPath | None = setting(
        None, "CSV with the columns from, to, metres, sigma: spatial distances measured between these points."
    )
    sigma_px: float = setting(1.0, "Standard error of measurements in the photographs, where the file states none.", "px", gt=0)
    origin: Literal["centre", "corner"] | None = setting(
        None,
        "Origin (0, 0) of the pixel coordinates: the centre of the upper-left pixel, or its corner; null: the corner for files of "
        "Pix4D and Metashape, the centre for others.",
    )
    absent: Literal["skip", "refuse"] = setting("skip", ABSENT)


class ControlFromGcpList(Settings):
    """Ground control in OpenDroneMap's format: the reference system, then lines of X Y Z, col row, photograph and name."""

    kind: Literal["gcp_list"]
    path: ProjectPath = setting(..., "The file gcp_list.txt.")
    crs: str | None = setting(
        None, "Reference system of the points, e.g. EPSG:4326, where the first line of the file names one that PROJ does not know."
    )
    # The defaults are those of targets surveyed with RTK GNSS and measured by hand on the screen.
    sigma_plan: float = setting(0.03, "Standard error of the points in X and Y.", "m", gt=0)
    sigma_height: float = setting(0.05, "Standard error of the points in Z.", "m", gt=0)
    sigma_px: float = setting(1.0, "Standard error of their measurements in the photographs.", "px", gt=0)
    check: tuple[str, ...] = setting((), "Names of the points that are check points and do not take part in the adjustment.")
    # Half a pixel: programs that display the photographs count from the corner, and the format does not say.
    origin: Literal["centre", "corner"] = setting(
        "centre", "Origin (0, 0) of the pixel coordinates: the centre of the upper-left pixel (as in OpenDroneMap), or its corner."
    )
    absent: Literal["skip", "refuse"] = setting("skip", ABSENT)


class ControlFromScans(Settings):
    """Targets of scans that the stage `registration` has put into the project's system, with the precision that they have there."""

    kind: Literal["scans"]
    measurements: ProjectPath = setting(
        ..., "CSV with the columns name, photo, col, row, sigma (pixels) of the targets in the photographs."
    )
    check: tuple[str, ...] = setting((), "Names of the targets that are check points and do not take part in the block adjustment.")
    absent: Literal["skip", "refuse"] = setting("skip", ABSENT)


class ControlFromTargets(SurveyedPoints):
    """Coded targets (AprilTag, ArUco, ring codes) that are found in the photographs by themselves; without coordinates they are
    tie points."""

    kind: Literal["targets"]
    points: ProjectPath | None = setting(
        None,
        "Coordinates of the targets, a list as for kind: files; names are those of the codes (tag36h11-7, ring12-7), or their "
        "numbers. null: none are known.",
    )
    distances: ProjectPath | None = setting(
        None, "CSV with the columns from, to, metres, sigma: scale bars, or distances measured between targets."
    )


class NoControl(Settings):
    """No ground control."""

    kind: Literal["none"]


class SimulatedControl(Settings):
    """The control files that the stage `simulation` writes."""

    kind: Literal["simulated"]


ControlSource = Annotated[
    ControlFromFiles | ControlFromGcpList | ControlFromScans | ControlFromTargets | NoControl | SimulatedControl,
    Field(discriminator="kind"),
]


Point = tuple[float, float, float]


class FacadeFound(Settings):
    """The upright plane, to a whole degree, near which most of the tie points lie."""

    kind: Literal["facade"] = "facade"


class FittedPlane(Settings):
    """The plane near which most of the tie points lie, upright or not."""

    kind: Literal["fit"]


class PlaneOfPoints(Settings):
    """The plane through three points."""

    kind: Literal["points"]
    points: tuple[Point, Point, Point] = setting(..., "X, Y, Z of the points.", "m")

    @model_validator(mode="after")
    def _is_no_line(self) -> Self:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self.points
        u, v = (bx - ax, by - ay, bz - az), (cx - ax, cy - ay, cz - az)
        across = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        if math.hypot(*across) <= 1e-6 * math.hypot(*u) * math.hypot(*v):
            raise ValueError("the three points of the plane are on one line; give three that form a triangle")
        return self


class PlaneAcross(Settings):
    """The plane through a point, across a direction."""

    kind: Literal["normal"]
    point: Point = setting(..., "A point of the plane.", "m")
    normal: Point = setting(..., "The direction across it, of any length; its front is where most photographs stand.")

    @model_validator(mode="after")
    def _has_a_direction(self) -> Self:
        if not any(self.normal):
            raise ValueError("the normal of the plane is (0, 0, 0); give the direction towards the viewer")
        return self


PlaneChoice = Annotated[FacadeFound | FittedPlane | PlaneOfPoints | PlaneAcross, Field(discriminator="kind")]


class MapSurface(Settings):
    """The surface stands on the map: a height for every cell."""

    kind: Literal["map"] = "map"
    area: Literal["auto"] | tuple[float, float, float, float] | ProjectPath = setting(
        "auto",
        "Where the surface is made, checked and textured: x and y of the lower left corner, then of the upper right one, or a file "
        "of polygons (GeoPackage, GeoJSON), relative to the project's root. Nothing is matched outside. auto: all ground that "
        "pairs of photographs see, but for background that they see in pixels three times as coarse as usual.",
        "m",
    )
    origin: tuple[float, float] = setting(
        (0.0, 0.0), "A corner of the cells: all others are whole cells away, as on the grid of a client or a mapping office.", "m"
    )
    cell: Literal["auto"] | Annotated[float, Field(gt=0)] = setting(
        "auto", "Cell size, unless the stage densification names another; auto: by the ground pixel.", "m"
    )

    @property
    def area_file(self) -> str | None:
        """The file of polygons that names the area."""
        return self.area if isinstance(self.area, str) and self.area != "auto" else None

    @model_validator(mode="after")
    def _area_is_one(self) -> Self:
        if isinstance(self.area, tuple):
            _check_area(self.area)
        elif self.area != "auto" and not self.area.lower().endswith((".gpkg", ".geojson", ".json")):
            raise ValueError(f"the area '{self.area}' is no file of polygons; give .gpkg or .geojson, or four numbers")
        return self


class PlaneSurface(Settings):
    """The surface stands on a plane in space, a facade or a wall: a distance before it for every cell. All stages after the
    orientation work in the system of that plane: x to the right, y upwards, heights towards the photographs."""

    kind: Literal["plane"]
    plane: PlaneChoice = setting(FacadeFound(), "Where the plane is.")
    area: Literal["auto"] | tuple[float, float, float, float] = setting(
        "auto",
        "Where on the plane the surface is made: x and y of the lower left corner, then of the upper right one, in the system of "
        "products/plane.json. auto: where the tie points of the wall are, without what photographs show far beside or behind it.",
        "m",
    )

    @property
    def area_file(self) -> None:
        """Polygons are drawn on the map."""
        return None

    @model_validator(mode="after")
    def _area_is_one(self) -> Self:
        _check_area(self.area)
        return self


def _check_area(area: Literal["auto"] | tuple[float, float, float, float]) -> None:
    if area != "auto" and not (area[0] < area[2] and area[1] < area[3]):
        raise ValueError("the area has no inside; give x and y of its lower left corner, then of its upper right one")


SurfaceGround = Annotated[MapSurface | PlaneSurface, Field(discriminator="kind")]


class Tolerances(Settings):
    """Root mean square errors that the survey allows."""

    plan: float | None = setting(None, "In plan, of the distance; null: nothing is asked for.", "m", gt=0)
    height: float | None = setting(None, "In height; null: nothing is asked for.", "m", gt=0)


class Project(Settings):
    """Everything in a workflow file except its stages."""

    # A folder name on every system: lower case, because some file systems do not distinguish case.
    project: str = setting(..., "Name of the project; its results go to runs/<project>.", pattern=r"^[a-z0-9][a-z0-9_-]*$")
    crs: str = setting(..., "Projected coordinate reference system in metres, e.g. EPSG:2100; a vertical one may follow after +.")
    photographs: Photographs = setting(..., "Where the photographs are.")
    cameras: CameraSource = setting(CameraFromExif(kind="exif"), "Where the interior orientation comes from.")
    positions: Positions = setting(PositionsFromExif(kind="exif"), "Where the positions of the photographs come from.")
    control: ControlSource = setting(NoControl(kind="none"), "Ground control and check points.")
    grid: SurfaceGround = setting(MapSurface(), "What the surface stands on: the map, or a plane such as a facade.")
    tolerances: Tolerances = setting(
        Tolerances(),
        "What the survey allows: report and signature say of every product whether it keeps that, and by what evidence.",
    )
    acceptance: Acceptance = setting(
        NoAcceptance(kind="none"), "What a delivery must keep, clause by clause, for `orthomill accept`; a profile with its limits."
    )
    # Multiples of 64: pyramid levels and the blocks of exported GeoTIFFs divide a tile without a rest.
    tile: int = setting(512, "Side of a tile: the unit of work, of storage and of memory.", "px", ge=128, le=8192, multiple_of=64)
    sheets_above: float = setting(
        40.0,
        "Size, not compressed, above which a raster product is written as sheets of 16384 x 16384 px, by many workers at once, and "
        "a virtual raster (.vrt) that joins them; below it is one GeoTIFF, which one worker joins in the end.",
        "GB",
        gt=0,
    )
