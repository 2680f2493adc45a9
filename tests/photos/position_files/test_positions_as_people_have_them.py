"""Positions files of every kind: the same photographs, in the same places, whatever program wrote the file."""

import struct
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Transformer
from pyproj.transformer import TransformerGroup

from orthomill.schemas.errors import OrthomillError
from orthomill.schemas.maps.geoid_grids import with_grids_of_the_system
from orthomill.schemas.photo import Header
from orthomill.schemas.project import PositionsFromExif, PositionsFromFile
from orthomill.schemas.survey_files.text_encoding import decoded
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.survey_system import transform_surveyed
from orthomill.tasks.photos.index import Limits, index_photos
from orthomill.tasks.photos.position_files.attitude_conventions import from_yaw_pitch_roll
from orthomill.tasks.photos.report.position_sentences import assumptions, heights_sentence, read_sentence, what_was_read

UTM = "EPSG:32632"
# Strips of unequal bases, so that a shift by one exposure is none of them.
PLACES = np.array(
    [(391000.137 + x, 4987000.263 + y, 350.0 + i / 8) for i, (x, y) in enumerate([(0, 0), (14, 2), (31, 0), (31, 25), (9, 25)])]
)
NAMES = tuple(f"DJI_{i + 1:04d}" for i in range(len(PLACES)))
SECONDS = (0.0, 3.0, 7.0, 15.0, 20.0)
LIMITS = Limits(megapixels=50)
YPR = ((12.0, 1.0, -2.0), (12.5, 0.0, -1.0), (13.0, 2.0, 0.5), (192.0, -1.0, 2.0), (193.0, 0.5, 1.0))


@cache
def degrees() -> np.ndarray:
    lon, lat = Transformer.from_crs(UTM, "EPSG:4326", always_xy=True).transform(PLACES[:, 0], PLACES[:, 1])
    return np.column_stack([lon, lat, PLACES[:, 2]])


def dms(value: float) -> str:
    whole = int(value)
    return f"({whole}) ({int((value - whole) * 60)}) ({((value - whole) * 60 % 1) * 60:.6f})"


def headers(gps: bool = False, time: bool = False, names=NAMES, **tags) -> tuple[Header, ...]:
    found = []
    for name, place, second in zip(names, degrees(), SECONDS, strict=True):
        own = {"FocalLength": "(5)", **tags}
        if gps:
            own |= {"GPSLongitude": dms(place[0]), "GPSLongitudeRef": "E", "GPSLatitude": dms(place[1]), "GPSLatitudeRef": "N"}
            own |= {"GPSAltitude": f"({place[2]})"}
        if time:
            own |= {"DateTimeOriginal": f"2023:05:17 10:15:{2 + int(second):02d}"}
        found.append(Header(path=f"in/{name}.JPG", width=800, height=450, bands=3, dtype="uint8", tags=own))
    return tuple(found)


def lines(form: str, head: str = "", values: np.ndarray | None = None) -> str:
    rows = PLACES if values is None else values
    found = [head] if head else []
    for i, (name, (x, y, z)) in enumerate(zip(NAMES, rows.tolist(), strict=True)):
        yaw, pitch, roll = YPR[i]
        found.append(form.format(name=name, x=x, y=y, z=z, yaw=yaw, pitch=pitch, roll=roll, n=i + 1, t=SECONDS[i]))
    return "\n".join(found) + "\n"


def mrk() -> str:
    form = "{n}\t{t}\t[2262]\t  -12,N\t   -5,E\t   75,V\t{y},Lat\t{x},Lon\t{z},Ellh\t0.014, 0.011, 0.021\t50,Q"
    return lines(form, values=degrees())


def pos(q: int = 1, drop: int = 0) -> str:
    head = (
        "% program   : RTKLIB\n%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)"
    )
    rows = []
    for i, (x, y, z) in enumerate(degrees().tolist()):
        time = f"2023/05/17 08:15:{20.4 + SECONDS[i]:06.3f}"
        rows.append(f"{time}   {y!r}   {x!r}   {z!r}   {q}  12   0.014   0.011   0.021   0.0   0.0   0.0   0.3   99.9")
    return "\n".join([head, *rows[drop:]]) + "\n"


OWN = "photo,x,y,z,sigma_x,sigma_y,sigma_z"
OWN_LINE = "{name},{x},{y},{z},0.011,0.014,0.021"
PIX4D = "{name}.JPG,{y},{x},{z}"


def placed(text: str | bytes, given=None, crs: str = UTM, **more):
    read = text if isinstance(text, str) else decoded(text, "positions.csv")
    source = PositionsFromFile(kind="file", path="positions.csv", **more)
    return index_photos(given or headers(), crs, source, LIMITS, read).photos


FILES = {
    "our own": lambda: placed(lines(OWN_LINE, OWN)),
    "our own, semicolons and decimal commas": lambda: placed(lines(OWN_LINE, OWN).replace(",", ";").replace(".", ",")),
    "our own in capitals with #": lambda: placed(lines(OWN_LINE, "#" + OWN.upper())),
    "tabs": lambda: placed(lines(OWN_LINE, OWN).replace(",", "\t")),
    "UTF-16": lambda: placed(lines(OWN_LINE, OWN).encode("utf-16")),
    "names in small letters with folders": lambda: placed(lines(OWN_LINE, OWN).replace("DJI_", "flight/dji_")),
    "northing first": lambda: placed(lines("{name},{y},{x},{z},0.011,0.014,0.021", OWN)),
    "northing first, by the tags": lambda: placed(lines("{name},{y},{x},{z},0.011,0.014,0.021", OWN), headers(gps=True)),
    "names for easting": lambda: placed(
        lines("{name};{x};{y};{z};0.02;0.03", "Name;Easting;Northing;Height;Accuracy_horz;Accuracy_vert")
    ),
    "millimetres by the header": lambda: placed(
        lines("{name},{x},{y},{z},11,14,21", "photo,x,y,z,sigma_x [mm],sigma_y [mm],sigma_z [mm]")
    ),
    "millimetres by the workflow": lambda: placed(lines("{name},{x},{y},{z},11,14,21", OWN), errors_in="mm"),
    "degrees in x and y": lambda: placed(lines(OWN_LINE, OWN, degrees())),
    "Metashape": lambda: placed(lines("{name}.JPG,{x},{y},{z},0.02", "#Label,Longitude,Latitude,Altitude,Accuracy_(m)", degrees())),
    "Metashape with its system": lambda: placed(
        lines(
            "{name},{x},{y},{z},0.02,0.03,0.02",
            '# CoordinateSystem: "WGS 84 / UTM zone 32N (EPSG::32632)"\n#Label,X/East,Y/North,Z/Altitude,'
            "Accuracy_X_(m),Accuracy_Y_(m),Accuracy_Z_(m)",
        )
    ),
    "Pix4D without header": lambda: placed(lines(PIX4D + ",0.02,0.03", values=degrees())),
    "Pix4D projected": lambda: placed(lines("{name}.JPG,{x},{y},{z},0.02,0.03")),
    "Pix4D with header": lambda: placed(
        lines(
            PIX4D + ",0.02,0.03",
            "imagename,latitude [decimal degrees],longitude [decimal degrees],altitude [meter],"
            "Accuracy Horz [meter],Accuracy Vert [meter]",
            degrees(),
        )
    ),
    "Pix4D without header and extensions": lambda: placed(lines("{name},{y},{x},{z},0.02,0.03", values=degrees())),
    "titles above the names of columns": lambda: placed(lines(OWN_LINE, f"Flight 3\nover the quarry\n{OWN}")),
    "REDtoolbox": lambda: placed(
        lines(
            "{name}.JPG;{y};{x};{z};0.014;0.011;0.021;1",
            "# REDtoolbox v2.85\nImageName;Latitude[deg];Longitude[deg];EllipsoidHeight[m];StdDev_N[m];StdDev_E[m];StdDev_U[m];Q",
            degrees(),
        )
    ),
    "receiver with centimetres": lambda: placed(
        lines("{name},{y},{x},{z},2,3", "photo,lat,lon,z,Horizontal accuracy (cm),Vertical accuracy (cm)", degrees())
    ),
    "exiftool": lambda: placed(
        exiftool(
            lines('./{name}.JPG,"{y}","{x}",{z} m Above Sea Level', "SourceFile,GPSLatitude,GPSLongitude,GPSAltitude", degrees())
        ),
        sigma_plan=0.02,
        sigma_height=0.03,
    ),
    "degrees and easting": lambda: placed(
        lines(
            "{name},{y},{x},391000,4987000,{z},0.02,0.03", "photo,lat,lon,easting,northing,ellipsoidal height,acch,accv", degrees()
        )
    ),
    "feet by the names of columns": lambda: placed(
        feet(lines("{name},{x},{y},{z},0.02,0.03", "photo,lon,lat,altitude (ft),acch,accv", degrees()))
    ),
    "geocentric": lambda: placed(geocentric(lines(OWN_LINE, OWN))),
    "geocentric by a comment": lambda: placed("# EPSG:4978\n" + geocentric(lines(OWN_LINE, OWN))),
    "UTF-16 without its mark": lambda: placed(lines(OWN_LINE, OWN).encode("utf-16-le")),
    "ends of lines of old computers": lambda: placed(lines(OWN_LINE, OWN).replace("\n", "\r")),
    "geo.txt without extensions": lambda: placed(lines("{name} {x} {y} {z} 0 0 0 0.02 0.03", UTM)),
    "geo.txt with commas": lambda: placed(lines("{name}.JPG,{x},{y},{z},0,0,0,0.02,0.03", "WGS 84 UTM 32N")),
    "geo.txt": lambda: placed(lines("{name}.JPG {x} {y} {z}", UTM), sigma_plan=0.02, sigma_height=0.03),
    "geo.txt in degrees with everything": lambda: placed(
        lines("{name}.JPG {x} {y} {z} {yaw} {pitch} {roll} 0.02 0.03 note", "EPSG:4326", degrees())
    ),
    "senseFly geoinfo": lambda: placed(
        lines(
            "{name}.JPG {y} {x} 301.0 {z} {yaw} {pitch} {roll}",
            "fileName latitude longitude altitude_amsl altitude_wgs84 heading pitch roll",
            degrees(),
        ),
        sigma_plan=0.02,
        sigma_height=0.03,
    ),
    "heights of GPS": lambda: placed(
        lines("{name},{y},{x},{z}", "image_name,lat,lon,gps_height", degrees()), sigma_plan=0.02, sigma_height=0.03
    ),
    "time marks by their numbers": lambda: placed(mrk()),
    "events in their order": lambda: placed(pos(), headers(time=True)),
    "events by places": lambda: placed(pos(), headers(gps=True)),
    "events with semicolons": lambda: placed(semicolons(pos()), headers(time=True)),
    "events with the name of the device": lambda: placed(pos().replace("99.9", "99.9 rover7"), headers(time=True)),
    "events without comments": lambda: placed("\n".join(pos().splitlines()[2:]), headers(time=True)),
    "events in geocentric coordinates": lambda: placed(pos_of_space(), headers(time=True)),
}


def exiftool(text: str) -> str:
    """Degrees as exiftool writes them by default; quotes are doubled in a cell of CSV."""
    for x, y, _ in degrees().tolist():
        for value, letter in ((x, "E"), (y, "N")):
            minutes = value % 1 * 60
            text = text.replace(repr(value), f'{int(value)} deg {int(minutes)}\' {minutes % 1 * 60:.8f}"" {letter}')
    return text


def geocentric(text: str) -> str:
    to_space = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    for (x, y, z), (lon, lat, _) in zip(PLACES.tolist(), degrees().tolist(), strict=True):
        text = text.replace(f"{x!r},{y!r},{z!r}", ",".join(f"{value:.4f}" for value in to_space.transform(lon, lat, z)))
    return text


def feet(text: str) -> str:
    for z in PLACES[:, 2].tolist():
        text = text.replace(f",{z!r},", f",{z / 0.3048!r},")
    return text


def semicolons(text: str) -> str:
    return "\n".join(line if line.startswith("%") else line.replace("   ", ";").replace("  ", ";") for line in text.splitlines())


def pos_of_space() -> str:
    to_space = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    text = pos().replace("latitude(deg) longitude(deg)  height(m)", "x-ecef(m)  y-ecef(m)  z-ecef(m)")
    for x, y, z in degrees().tolist():
        text = text.replace(f"{y!r}   {x!r}   {z!r}", "   ".join(f"{value:.4f}" for value in to_space.transform(x, y, z)))
    return text


@pytest.mark.parametrize("case", FILES)
def test_positions_are_read_as_they_are(case):
    photos = FILES[case]()
    np.testing.assert_allclose([photo.position for photo in photos.photos], PLACES, atol=2e-3, err_msg=case)
    for photo in photos.photos:
        assert all(0.01 < value < 0.05 for value in photo.position_sigma), photo.position_sigma
    assert f"{len(NAMES)} positions, {len(NAMES)} used" in read_sentence(photos.positions_read)


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("northing first", "The northing (or latitude) comes first in it"),
        ("degrees in x and y", "as the numbers show, which are degrees"),
        ("events in their order", "in their order; the times of exposure agree"),
        ("events by places", "in their order; the places in the GPS tags agree"),
        ("time marks by their numbers", "by the numbers in the names, which nothing confirms"),
        ("events in their order", "positions of the antenna"),
        ("Metashape with its system", "Metashape reference, 5 positions, 5 used, in EPSG:32632 (as the file states)"),
        ("senseFly geoinfo", "Positions: senseFly geoinfo"),
        ("geocentric", "as the numbers show, which are geocentric"),
        ("geo.txt in degrees with everything", "Its angles (yaw, pitch, roll) are taken as approximate attitudes"),
    ],
)
def test_what_was_assumed_is_said(case, words):
    assert words in read_sentence(FILES[case]().positions_read)


def test_fixes_and_what_they_are_worth():
    fixed, floating = (placed(pos(q), headers(time=True)) for q in (1, 2))
    assert fixed["DJI_0001"].fix == "fixed" and fixed["DJI_0001"].position_sigma == (0.011, 0.014, 0.021)
    assert floating["DJI_0001"].fix == "float" and floating["DJI_0001"].position_sigma == (0.2, 0.2, 0.4)
    assert "5 of them are no fixed solutions" in read_sentence(floating.positions_read)
    assert fixed["DJI_0001"].height_kind == "ellipsoidal"
    single = placed(mrk().replace("50,Q", "0,Q", 1))
    assert single["DJI_0001"].position is None and single["DJI_0002"].position is not None


def test_heights_of_the_tags_stand_in_for_missing_ones():
    found = placed(lines("{name}.JPG {x} {y}", UTM), headers(gps=True))
    assert found["DJI_0002"].position[2] == pytest.approx(PLACES[1, 2])


@pytest.mark.parametrize("height", ["", "nan", "0", "-9999", "-32768"])
def test_heights_that_a_table_lacks_are_as_good_as_tags(height):
    found = placed(lines("{name},{x},{y}," + height + ",0.02,0.03", "photo,x,y,z,acch,accv"), headers(gps=True))
    assert found["DJI_0002"].position[2] == pytest.approx(PLACES[1, 2]) and found["DJI_0002"].position_sigma == (0.02, 0.02, 5.0)
    assert "5 of them have no height in it, and have that of the GPS tags" in read_sentence(found.positions_read)


def test_receivers_without_a_position_are_at_0_0():
    found = placed(lines(OWN_LINE, OWN).replace("DJI_0003,391031.137,4987000.263", "DJI_0003,0,0"))
    assert found["DJI_0003"].position is None and found["DJI_0004"].position is not None
    assert "1 lines hold no position" in read_sentence(found.positions_read)


def test_angles_that_are_all_0_are_none():
    assert FILES["geo.txt with commas"]()["DJI_0001"].attitude is None


@pytest.mark.parametrize(("place", "sigma"), [("{y:.5f},{x:.5f}", 0.32), ("{y:.6f},{x:.6f}", 0.038), ("{y},{x}", 0.02)])
def test_rounded_degrees_are_no_better_than_their_rounding(place, sigma):
    """1e-5 degrees are 1.1 m; of 7 decimals nothing is left to say."""
    found = placed(lines("{name}," + place + ",{z},0.02,0.03", "photo,lat,lon,z,acch,accv", degrees()))
    assert found["DJI_0001"].position_sigma == pytest.approx((sigma, sigma, 0.03), abs=0.002)
    assert ("rounded" in read_sentence(found.positions_read)) == (sigma > 0.02)


@pytest.mark.parametrize(
    ("moved", "said"),
    [
        ((0, 0, -300), "300 m below those of the GPS tags"),
        ((0, 0, 47), "47 m above those of the GPS tags, as heights above the sea and above the ellipsoid are apart"),
        ((0, 500, 0), "500 m from where the GPS tags say"),
        ((0, 20, 10), ""),
    ],
)
def test_what_tags_say_of_positions(moved, said):
    found = placed(lines(OWN_LINE, OWN, PLACES + moved), headers(gps=True))
    told = read_sentence(found.positions_read)
    assert said in told if said else "GPS tags" not in told


def test_a_step_of_heights_against_the_tags_is_told():
    other = np.zeros_like(PLACES)
    other[-2:, 2] = -47.0
    told = read_sentence(placed(lines(OWN_LINE, OWN, PLACES + other), headers(gps=True)).positions_read)
    assert "the heights of DJI_0004, DJI_0005 are 47 m lower than those of the others" in told


@pytest.mark.parametrize(("by", "said"), [(1, "a photograph later"), (-2, "2 photographs earlier"), (0, "")])
def test_names_that_are_moved_against_their_photographs_are_told(by, said):
    found = placed(lines(OWN_LINE, OWN, np.roll(PLACES, by, axis=0)), headers(gps=True))
    told = read_sentence(found.positions_read)
    assert f"taken {said}: its names seem to be moved" in told if said else "moved" not in told


def test_lines_without_standard_errors_have_the_default():
    found = placed(lines(OWN_LINE, OWN).replace("0.011,0.014,0.021", ",,", 1))
    assert found["DJI_0001"].position_sigma == (3.0, 3.0, 5.0) and found["DJI_0002"].position_sigma == (0.011, 0.014, 0.021)
    assert "states no standard errors for 1 of them" in read_sentence(found.positions_read)


REFUSED = [
    (
        lambda: placed(lines("{name},{x},{y},{z},11,14,21", OWN)),
        r"standard errors of 11, 14, 21.*are they millimetres\? .*errors_in: mm",
    ),
    (lambda: placed(mrk().replace("0.014, 0.011, 0.021", "14, 11, 21")), "fixed ambiguities"),
    (lambda: placed(pos(drop=1), headers(time=True)), "holds 4 exposures without names, the project 5 photographs"),
    (lambda: placed(pos() + pos().split("\n", 2)[2] * 40, headers(time=True)), "epochs of a trajectory.*_events.pos"),
    (lambda: placed(lines(OWN_LINE, OWN).replace("DJI", "IMG")), "names none of the photographs: it has IMG_0001"),
    (lambda: placed(lines(OWN_LINE, OWN).replace(".", ",")), "Line 2 of the positions file has 13 cells"),
    (
        lambda: placed(lines(OWN_LINE, OWN).replace("391014.137", "391014.137.0")),
        "Line 3 of the positions file does not hold six numbers",
    ),
    (lambda: placed(lines(OWN_LINE, OWN), crs="EPSG:27700"), "which the project's crs EPSG:27700 is not for"),
    (lambda: placed(lines(OWN_LINE, OWN, degrees()), crs="EPSG:2100"), "lie outside of it|is not for"),
    (lambda: placed(lines("{name},{x},{y}", "photo,x,y")), "has no column z"),
    (lambda: placed(b"PK\x03\x04 and so on"), r"is a spreadsheet \(.xlsx, .ods\).*CSV"),
    (lambda: placed("$GPGGA,081520.40,4501.68,N,00736.98,E,1,12,0.8,301.5,M,47.0,M,,*5B\n"), "is a log of a receiver"),
    (lambda: placed("<kml xmlns='x'/>"), "is a KML file"),
    (lambda: placed(""), "The positions file is empty"),
    (lambda: placed('[{"filename": "DJI_0001.JPG"}]'), r"it begins with '\[\{\"filename\": \"DJI_0001.JPG\"\}\]'"),
    (lambda: placed(lines("{name}.JPG,{y},{x},{z},0.02,0.02,0.03", values=degrees())), "may be standard errors or angles"),
    (lambda: placed(feet(lines("{name},{x},{y},{z}, ", "photo,lon,lat,z,note", degrees())), headers(gps=True)), "they are in feet"),
    (
        lambda: placed(lines(OWN_LINE, OWN, PLACES + np.array([50000, 0, 0])), headers(gps=True)),
        "50 km from where their GPS tags say",
    ),
    (lambda: placed(lines("{name},{x:.2E},{y:.2E},{z}", "photo,x,y,z")), "Line 2 .* holds '3.91E.05', which a spreadsheet has cut"),
    (lambda: placed(lines("{name},{x},{y},3500000", "photo,x,y,z")), "Line 2 of the positions file is wrong: z is 3.5e.06"),
    (lambda: placed(lines("{name}.JPG {x} {y}", UTM)), "gives no height for DJI_0001, .* and the GPS tags have none"),
    (lambda: placed(lines("{name}.JPG {x} {y} {z}", "EPSG:1")), "'EPSG:1' of the positions is not known to PROJ"),
    (lambda: placed(b"\x00" + lines(OWN_LINE, OWN).encode()), "holds NUL bytes"),
    (lambda: placed(pos().replace("latitude(deg)", "e-baseline(m)")), "holds baselines from the base station"),
    (lambda: placed(lines(OWN_LINE, OWN), crs="EPSG:3857", given=headers()), "EPSG:3857|not for"),
]


@pytest.mark.parametrize(("make", "sentence"), REFUSED)
def test_what_cannot_be_right_is_refused_with_its_line(make, sentence):
    with pytest.raises(OrthomillError, match=sentence):
        make()


def test_exposures_that_contradict_the_photographs_are_refused():
    """Times that run otherwise than the events."""
    given = list(headers(time=True))
    tags = [header.tags["DateTimeOriginal"] for header in given]
    moved = [tags[0], tags[1], tags[2].replace(":09", ":12"), tags[3], tags[4]]
    given = tuple(h.model_copy(update={"tags": h.tags | {"DateTimeOriginal": t}}) for h, t in zip(given, moved, strict=True))
    with pytest.raises(OrthomillError, match="in their order the times of exposure in the tags contradict it"):
        placed(pos(), given)


def test_numbers_that_the_places_contradict_are_no_assignment():
    """Photographs numbered the other way round than the marks: refused, or matched in the order of their places."""
    with pytest.raises(OrthomillError, match="places in the GPS tags contradict it"):
        placed(mrk(), headers(gps=True, names=NAMES[::-1]))


@pytest.mark.parametrize(
    ("angles", "looks", "top"),
    [
        ((0.0, 0.0, 0.0), (0, 0, -1), (0, 1, 0)),
        ((90.0, 0.0, 0.0), (0, 0, -1), (1, 0, 0)),
        ((0.0, 30.0, 0.0), (0, 0.5, -0.8660254), (0, 0.8660254, 0.5)),
        ((0.0, 0.0, 30.0), (-0.5, 0, -0.8660254), (0, 1, 0)),
    ],
)
def test_yaw_pitch_roll_turn_the_camera_as_their_sources_say(angles, looks, top):
    """Nose up: the camera looks ahead. Right wing down: it looks to the left."""
    rotation = rotation_matrix(*np.radians(from_yaw_pitch_roll(*angles)))
    np.testing.assert_allclose(-rotation[2], looks, atol=1e-7)
    np.testing.assert_allclose(rotation[1], top, atol=1e-7)


def test_pitch_of_a_gimbal_is_that_of_its_line_of_sight():
    text = lines("{name},{x},{y},{z},1,1,1,{yaw},-90,0", OWN + ",yaw,pitch,roll")
    nadir = placed(text)["DJI_0001"]
    aircraft = placed(text.replace(",-90,", ",0,"))["DJI_0001"]
    assert nadir.attitude == pytest.approx(aircraft.attitude) and nadir.attitude_of == "file"
    assert nadir.attitude[:2] == pytest.approx((0.0, 0.0), abs=1e-9)
    # Yaw 12 degrees clockwise from north, which lies 1 degree to the right of the map's y axis west of the middle of the zone.
    assert nadir.attitude[2] == pytest.approx(-12.0 - 0.973, abs=0.01)


GRID = """
import sys
import numpy as np
from pyproj import datadir
datadir.append_data_dir(sys.argv[1])
from orthomill.schemas.photo import Header
from orthomill.schemas.project import ControlFromGcpList, PositionsFromExif, PositionsFromFile
from orthomill.tasks.photos.index import Limits, index_photos
from orthomill.tasks.orientation.control.control_system import control_from_list
tags = {"GPSLongitude": "(7.62)", "GPSLongitudeRef": "E", "GPSLatitude": "(45.03)", "GPSLatitudeRef": "N", "GPSAltitude": "(349.5)"}
head = (Header(path="a.JPG", width=800, height=450, bands=3, dtype="uint8", tags=tags),)
def of(crs, source, text=None):
    photos = index_photos(head, crs, source, Limits(50), text).photos
    return photos
exif = of("EPSG:32632+5773", PositionsFromExif(kind="exif", crs="EPSG:4979"))
print(exif["a"].position[2], exif["a"].height_kind, exif.heights.transformed)
mark = "1\\t1.0\\t[2262]\\t-12,N\\t-5,E\\t75,V\\t45.03,Lat\\t7.62,Lon\\t349.5,Ellh\\t0.014, 0.011, 0.021\\t50,Q"
file = of("EPSG:32632+5773", PositionsFromFile(kind="file", path="m"), mark.replace("1\\t1.0", "1\\t1.0"))
print(file["a"].position[2], file["a"].height_kind, file.heights.transformed)
flat = of("EPSG:32632", PositionsFromFile(kind="file", path="m"), mark)
x, y, _ = flat["a"].position
text = f"EPSG:32632+5773\\n{x} {y} 300.0 10 20 a.JPG g1\\n"
control = control_from_list(flat, text, ControlFromGcpList(kind="gcp_list", path="g"), "EPSG:32632")
print(control.points[0].xyz[2], control.findings[0].code, control.findings[0].shift_m)
"""


def test_ellipsoidal_heights_become_those_of_the_project_with_its_grid(tmp_path: Path):
    """A grid of the name that PROJ asks for, 40 m everywhere (GTX: PROJ, "Vertical grid shift file format")."""
    rows, cols = 19, 37
    header = struct.pack(">4d2i", -90.0, -180.0, 10.0, 10.0, rows, cols)
    (tmp_path / "egm96_15.gtx").write_bytes(header + struct.pack(f">{rows * cols}f", *([40.0] * rows * cols)))
    run = subprocess.run([sys.executable, "-c", GRID, str(tmp_path)], capture_output=True, text=True, check=True, timeout=120)
    exif, file, control = (line.split() for line in run.stdout.splitlines())
    assert float(exif[0]) == pytest.approx(309.5, abs=1e-6) and exif[1:] == ["sea_level", "1"]
    assert float(file[0]) == pytest.approx(309.5, abs=1e-6) and file[1:] == ["sea_level", "1"]
    assert float(control[0]) == pytest.approx(340.0, abs=1e-3) and control[1:] == ["heights_of_two_systems", "40.0"]


@pytest.mark.filterwarnings("ignore:Best transformation")
def test_without_its_grid_heights_are_refused_with_its_address():
    with_grids_of_the_system()  # as the transformation does: packages of some programs bring the grid
    if TransformerGroup(CRS("EPSG:4979"), CRS(UTM + "+5773"), always_xy=True).best_available:
        pytest.skip("the grid is installed here")
    with pytest.raises(OrthomillError, match=r"us_nga_egm96_15\.tif.*https://cdn\.proj\.org/us_nga_egm96_15\.tif.*proj-data"):
        index_photos(headers(gps=True), UTM + "+5773", PositionsFromExif(kind="exif", crs="EPSG:4979"), LIMITS)


def test_heights_of_which_nothing_is_known_are_said_to_be():
    photos = index_photos(headers(gps=True), UTM + "+5773", PositionsFromExif(kind="exif"), LIMITS).photos
    assert photos.heights.unknown == 5 and photos["DJI_0001"].position[2] == pytest.approx(350.0)
    assert "Nothing tells what the heights of 5 positions refer to" in heights_sentence(photos.heights)
    flat = placed(mrk())
    assert "Heights are those of the positions, ellipsoid of WGS 84" in heights_sentence(flat.heights)


def test_a_system_without_heights_says_nothing_of_tags():
    with pytest.raises(OrthomillError, match=r"positions > crs: EPSG:32632 .* says nothing of heights"):
        index_photos(headers(gps=True), UTM, PositionsFromExif(kind="exif", crs=UTM), LIMITS)


def test_a_web_map_is_refused_with_its_scale_and_the_zone():
    with pytest.raises(OrthomillError, match=r"EPSG:3857 .* is 1\.41\d times as large as the ground .* EPSG:32632"):
        index_photos(headers(gps=True), "EPSG:3857", PositionsFromExif(kind="exif"), LIMITS)


@pytest.mark.parametrize(("case", "assumed"), [("our own", False), ("northing first", True), ("time marks by their numbers", True)])
def test_only_what_was_assumed_is_a_warning(case, assumed):
    photos = FILES[case]()
    note, warning = list(what_was_read(photos)), list(assumptions(photos))
    assert any(text.startswith("Positions: ") for text in (warning if assumed else note))
    assert not any(text.startswith("Positions: ") for text in (note if assumed else warning))


@pytest.mark.filterwarnings("ignore:Best transformation")
@pytest.mark.parametrize(
    ("crs", "place", "sentence"),
    [
        ("EPSG:3067+3900", (25.0, 61.0), "no grid for it is published; give heights in the project's own system"),
        ("EPSG:32632+5705", (7.6, 45.0), "no grid for it is published"),
        ("EPSG:32632+3855", (7.6, 45.0), r"lacks the grid us_nga_egm08_25\.tif; get it with"),
        ("EPSG:6343+5703", (-92.0, 46.8), r"lacks the grid us_noaa_g2018u0\.tif; get it with"),
        ("EPSG:25832+7837", (10.0, 50.0), r"lacks the grid de_bkg_gcg2016\.tif; get it with"),
    ],
)
def test_heights_that_proj_would_leave_as_they_are_are_refused(crs, place, sentence):
    """PROJ returns the height above the ellipsoid as one above the sea, and says so in the name of the operation only."""
    with pytest.raises(OrthomillError, match=sentence):
        transform_surveyed(np.array([[*place, 100.0]]), "EPSG:4979", crs)
