"""What photographs let expect of their block, from headers alone: positions of the stage `photos`, cameras of `calibration`, the
planned block of `orientation`. Above the stages, which do not know each other."""

from orthomill.schemas.errors import OrthomillError
from orthomill.schemas.findings.flight_findings import ExpectedFlight, FirstLook, PositionsBeside
from orthomill.schemas.photo import Header
from orthomill.schemas.project import PositionsFromExif, PositionsFromFile
from orthomill.tasks.calibration.report.known_cameras import from_exif
from orthomill.tasks.orientation.planned.flight_sentences import expected_flight
from orthomill.tasks.orientation.planned.object_views import UNKNOWN_VIEWS
from orthomill.tasks.photos.index import Limits, index_photos
from orthomill.tasks.photos.report.first_look import first_look


def look_ahead(headers: tuple[Header, ...], crs: str | None, beside: PositionsBeside | None = None) -> FirstLook:
    """What is found in photographs, and what is to be expected of their block, by the positions `beside` them where there are any.
    Raises OrthomillError as `first_look`."""
    seen = first_look(headers, crs, beside)
    used = tuple(header for header in headers if header.path in set(seen.used))
    return seen.model_copy(update={"expected": expected_of(used, crs, beside)})


def expected_of(headers: tuple[Header, ...], crs: str | None, beside: PositionsBeside | None = None) -> ExpectedFlight:
    """What is to be expected of the block; nothing for photographs that no run can use, which is for others to say."""
    if crs is None:
        nothing = "No positions in the tags: pattern, overlap and accuracy of the flight cannot be foreseen."
        return ExpectedFlight(pattern=f"{nothing} {UNKNOWN_VIEWS}")
    own = PositionsFromFile(kind="file", path=beside.path) if beside else PositionsFromExif(kind="exif")
    try:
        photos = index_photos(headers, crs, own, Limits(float("inf")), beside.text if beside else None).photos
        return expected_flight(photos, from_exif(photos).cameras)
    except OrthomillError:
        return ExpectedFlight()
