"""Files that hold anything: every reader answers with a value or with sentences that name the place, never with an internal error.

`make fuzz` draws many more cases than the tests. What was once found stays here as an example.
"""

import json
import math
import os
import random

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from small_site import make_site, photographs

from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import OrthomillError, PhotoError, WorkflowError
from orthomill.schemas.photo import Header, Photo, Photos
from orthomill.schemas.project import ControlFromGcpList, PositionsFromExif, PositionsFromFile
from orthomill.schemas.raster import Window
from orthomill.tasks.calibration.report.known_cameras import from_file
from orthomill.tasks.orientation.control.control_files import read_control
from orthomill.tasks.orientation.control.gcp_list import read_gcp_list
from orthomill.tasks.photos.index import Limits, index_photos

CASES = int(os.environ.get("ORTHOMILL_FUZZ", "150"))
"""cases of every test; seven tests make a thousand"""
fuzzed = settings(max_examples=CASES, suppress_health_check=list(HealthCheck))

NUMBERS = st.one_of(
    st.sampled_from(
        ["nan", "inf", "-inf", "1e400", "1e300", "1e-300", "0", "-0", "", " ", "4e9", "1_000", "0x10", "1,5", "٣", "9" * 400]
    ),
    st.floats(width=32).map(repr),
    st.integers(-(10**7), 10**7).map(str),
)
WORDS = st.one_of(
    st.sampled_from(["a", "a.jpg", "b", "P1", "control", "check", "tie", '"', "'", "#", '"a\nb"', "\ufeff", "\x00"]),
    st.text(max_size=8),
)
CELLS = st.one_of(NUMBERS, WORDS)
POSITIONS = "photo,x,y,z,sigma_x,sigma_y,sigma_z"
POINTS = "name,role,x,y,z,sigma_x,sigma_y,sigma_z"
MEASURED = "name,photo,col,row,sigma"
PHOTOS = Photos(
    photos=tuple(Photo(name=n, path=f"in/{n}.jpg", width=100, height=80, bands=3, dtype="uint8", camera="c") for n in ("a", "b"))
)
HEADERS = tuple(Header(path=f"in/{n}.jpg", width=100, height=80, bands=3, dtype="uint8") for n in ("a", "b"))


def tables(header: str):
    """Texts that begin like a table and go on with anything."""
    rows = st.lists(st.lists(CELLS, max_size=10).map(",".join), max_size=5).map("\n".join)
    return st.tuples(st.sampled_from([header, header + ",more", "\ufeff" + header, header.replace(",", ";"), ""]), rows).map(
        "\n".join
    )


def answered(call, error=WorkflowError, lines: int = 11):
    """The value of a call, or None where it answers with sentences of `error`."""
    try:
        return call()
    except error as caught:
        sentences = str(caught).splitlines()
        assert 1 <= len(sentences) <= lines, sentences
        assert all(len(sentence) < 1000 for sentence in sentences)
        return None


@pytest.mark.slow
@fuzzed
@given(tables(POSITIONS))
@example(POSITIONS + "\na,1,2,nan,1,1,1")
@example(POSITIONS + "\na,1,2,3,1,1,inf")
@example(POSITIONS + "\n" + "x" * 200_000 + ",1,2,3,1,1,1")
@example(POSITIONS + '\n"a,1,2,3,1,1,1')
@example("\ninf,nan,nan,nan,nan,nan,nan")
def test_positions(text):
    index = answered(lambda: index_photos(HEADERS, "EPSG:2100", PositionsFromFile(kind="file", path="p.csv"), Limits(100.0), text))
    for photo in index.photos.photos if index else ():
        if photo.position:
            assert all(abs(value) <= 1e8 for value in photo.position) and abs(photo.position[2]) <= 1e5
            assert all(1e-6 <= value <= 1e6 for value in photo.position_sigma)


@fuzzed
@given(tables(POINTS), tables(MEASURED))
@example(POINTS + '\nP1,control,1,2,3,"0.1\n",1,1', MEASURED)
@example("role," + POINTS.replace("role,", "") + "\ncontrol", MEASURED)
@example(POINTS + "\n" + "x" * 200_000, MEASURED)
def test_control(points, measured):
    control = answered(lambda: read_control(PHOTOS, points, measured))
    for point in control.points if control else ():
        assert all(abs(value) <= 1e8 for value in point.xyz[:2]) and not math.isinf(point.xyz[2]), "NaN: no height"


# Behind a system that nobody knows no row is read; and PROJ looks for a quarter of a second for a name that it does not have.
SYSTEMS = st.sampled_from(["EPSG:2100", "EPSG:4326", "WGS84 UTM 34N", "", "a", "nan 2"])


@fuzzed
@given(SYSTEMS, st.lists(st.lists(CELLS, max_size=8).map(" ".join), max_size=5).map("\n".join))
@example("EPSG:2100", "nan 2 3 4 5 a.jpg P1")
@example("EPSG:2100", "1 2 nan 4 5 a.jpg P1")
@example("\x00", "")
def test_gcp_list(system, rows):
    text = f"{system}\n{rows}"
    found = answered(lambda: read_gcp_list(PHOTOS, text, ControlFromGcpList(kind="gcp_list", path="g.txt")))
    for point in found.control.points if found else ():
        assert all(map(math.isfinite, point.xyz[:2])) and not math.isinf(point.xyz[2]), "NaN: no height"


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.floats()
    | st.integers()
    | st.text(max_size=5)
    | st.sampled_from([1e300, 1e-300, -1.0, 0.0, math.nan]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=10,
)
RIGHT = {"name": "c", "width": 100, "height": 80, "c": 90.0}
FIELDS = st.sampled_from([*Camera.model_fields, "cameras", "of_photo"])


@fuzzed
@given(
    st.one_of(
        st.dictionaries(FIELDS, JSON, max_size=4).map(lambda wrong: json.dumps(RIGHT | wrong)),
        JSON.map(json.dumps),
        st.text(max_size=30),
    )
)
@example(json.dumps(RIGHT | {"k1": 1e300}))
@example(json.dumps(RIGHT | {"c": 1e-300}))
@example(json.dumps(RIGHT | {"covariance": [[1, 2]]}))
@example(json.dumps(RIGHT | {"covariance": [[math.nan] * 8] * 8}))
@example("[" * 100_000)
def test_cameras(text):
    known = answered(lambda: from_file(PHOTOS, text, "camera.json"), (WorkflowError, PhotoError))
    for camera in known.cameras.cameras.values() if known else ():
        assert all(map(math.isfinite, camera.interior)) and camera.c > 0


TAGS = ("GPSLatitude", "GPSLongitude", "GPSAltitude", "GPSLatitudeRef", "GPSAltitudeRef", "FocalLength", "FocalLengthIn35mmFilm")
MORE_TAGS = ("FocalPlaneXResolution", "FocalPlaneResolutionUnit", "PixelXDimension", "Orientation", "Model", "DateTime")
VALUES = st.one_of(
    NUMBERS.map("({})".format), st.lists(NUMBERS, max_size=4).map(lambda parts: " ".join(f"({p})" for p in parts)), WORDS
)


@fuzzed
@given(st.lists(st.dictionaries(st.sampled_from(TAGS + MORE_TAGS), VALUES, max_size=8), min_size=1, max_size=4))
@example([{"GPSLatitude": "(46) (50) (33)", "GPSLongitude": "(22)", "GPSAltitude": "(4e9)"}])
@example([{"FocalPlaneXResolution": "(1)", "FocalPlaneResolutionUnit": "(1e300)"}])
def test_tags(tags):
    headers = tuple(
        Header(path=f"in/p{n}.jpg", width=100, height=80, bands=3, dtype="uint8", tags=of_one) for n, of_one in enumerate(tags)
    )
    index = answered(lambda: index_photos(headers, "EPSG:2100", PositionsFromExif(kind="exif"), Limits(100.0)), OrthomillError)
    for photo in index.photos.photos if index else ():
        assert photo.altitude is None or -12_000 <= photo.altitude <= 100_000
        assert photo.position is None or all(map(math.isfinite, photo.position))
        assert photo.focal_mm is None or 0 < photo.focal_mm < math.inf


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    return photographs(make_site(tmp_path_factory.mktemp("site")))[0]


@pytest.mark.parametrize("part", ["tags", "anywhere"])
def test_photographs(picture, part, capfd):
    """Random bytes in the tags of a photograph, or anywhere in it; also cut short."""
    whole = picture.read_bytes()
    for seed in range(CASES):
        chance = random.Random(seed)
        damaged = bytearray(whole)
        for _ in range(chance.randrange(1, 30)):
            damaged[chance.randrange(2, 900 if part == "tags" else len(whole))] = chance.randrange(256)
        if chance.random() < 0.2:
            del damaged[chance.randrange(len(damaged)) :]
        path = picture.with_name("damaged.jpg")
        path.write_bytes(damaged)
        header = answered(lambda path=path: read_header(path), PhotoError, lines=1)
        if header:
            whole_window = Window(0, 0, header.height, header.width)
            if header.height * header.width < 2_000_000:
                answered(lambda path=path, window=whole_window: read_pixels(path, window), PhotoError, lines=1)
            answered(
                lambda header=header: index_photos((header,), "EPSG:32615", PositionsFromExif(kind="exif"), Limits(9.0)),
                OrthomillError,
            )
    said = capfd.readouterr()
    assert said.out + said.err == "", "GDAL's own words are nobody's business"
