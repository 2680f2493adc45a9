"""Eighty control files, as programs and people write them: each is right, or refused with the line that is wrong.

One site: two photographs in UTM zone 32, three points. `place` gives any point in any system, so that every file has one answer.
"""

import json
from functools import cache

import numpy as np
import pytest
from pyproj import CRS, Transformer

from orthomill.schemas.errors import OrthomillError
from orthomill.schemas.observations import NO_HEIGHT
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import ControlFromFiles, ControlFromGcpList
from orthomill.schemas.survey_files.text_encoding import decoded
from orthomill.tasks.marking.given_points import marks_of
from orthomill.tasks.orientation.control.control_system import control_from_files, control_from_list

UTM = "EPSG:32632"
POINTS = {"P1": (391000.125, 4987010.25, 301.5), "P2": (391040.5, 4987055.75, 303.25), "P3": (390970.75, 4987080.375, 299.125)}
PIXELS = {"P1": ((100.5, 200.25), (110.5, 60.25)), "P2": ((620.0, 333.0), (611.5, 90.5)), "P3": ((40.25, 400.5), (55.5, 260.0))}
NAMES = ("DJI_0001", "DJI_0002")
PHOTOS = Photos(
    photos=tuple(
        Photo(
            name=name,
            path=f"in/{name}.JPG",
            width=800,
            height=450,
            bands=3,
            dtype="uint8",
            camera="c",
            position=(391000.0 + 12.0 * i, 4987045.0, 350.0),
        )
        for i, name in enumerate(NAMES)
    )
)


@cache
def place(name: str, system: str = UTM) -> tuple[float, float, float]:
    x, y = Transformer.from_crs(UTM, system, always_xy=True).transform(*POINTS[name][:2])
    unit = CRS(system).axis_info[0].unit_conversion_factor if CRS(system).is_projected else 1.0
    return x, y, POINTS[name][2] / unit


def gcp(form: str = "{x} {y} {z} {col} {row} {photo} {name}", system: str = UTM, head: str | None = None, k: float = 1.0) -> str:
    lines = [word for word in [system if head is None else head] if word]
    for name, pixels in PIXELS.items():
        for photo, (col, row) in zip(NAMES, pixels, strict=True):
            x, y, z = place(name, system)
            pixel = [repr(k * (value + 0.5) - 0.5) for value in (col, row)]
            lines.append(form.format(x=x, y=y, z=z, col=pixel[0], row=pixel[1], photo=f"{photo}.JPG", name=name))
    return "\n".join(lines) + "\n"


def table(form: str, head: str = "", system: str = UTM) -> str:
    lines = [head] if head else []
    for name in POINTS:
        x, y, z = place(name, system)
        lines.append(form.format(x=x, y=y, z=z, name=name))
    return "\n".join(lines) + "\n"


def marks(form: str = "{name},{photo},{col},{row},0.5", head: str = "name,photo,col,row,sigma", half: float = 0.0) -> str:
    lines = [head] if head else []
    for name, pixels in PIXELS.items():
        for photo, (col, row) in zip(NAMES, pixels, strict=True):
            lines.append(form.format(name=name, photo=f"{photo}.JPG", col=repr(col + half), row=repr(row + half)))
    return "\n".join(lines) + "\n"


def markers_xml(pinned: str = "true") -> str:
    cameras = "".join(f'<camera id="{i}" label="{name}.JPG"/>' for i, name in enumerate(NAMES))
    sigma = 'sx="0.02" sy="0.02" sz="0.03"'
    own = "".join(
        f'<marker id="{i}" label="{name}"><reference x="{p[0]!r}" y="{p[1]!r}" z="{p[2]!r}" {sigma}/></marker>'
        for i, (name, p) in enumerate(POINTS.items())
    )
    seen = "".join(
        f'<marker marker_id="{i}">'
        + "".join(
            f'<location camera_id="{j}" pinned="{pinned}" x="{c + 0.5!r}" y="{r + 0.5!r}"/>' for j, (c, r) in enumerate(pixels)
        )
        + "</marker>"
        for i, pixels in enumerate(PIXELS.values())
    )
    wkt = CRS(UTM).to_wkt("WKT1_GDAL").replace('"', "&quot;")
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="c"><cameras>{cameras}</cameras>'
        f"<markers>{own}</markers><frames><frame id='0'><markers>{seen}</markers></frame></frames><reference>{wkt}</reference>"
        "</chunk></document>"
    )


OWN = "name,role,x,y,z,sigma_x,sigma_y,sigma_z"
OWN_LINE = "{name},control,{x},{y},{z},0.02,0.02,0.03"


def angle(value: float, letters: str, form: str = "{d}°{m:02d}'{s:011.8f}\"{h}") -> str:
    degrees, minutes = int(abs(value)), int(abs(value) % 1 * 60)
    seconds = (abs(value) - degrees - minutes / 60) * 3600
    return form.format(d=degrees, m=minutes, s=seconds, h=letters[value < 0])


def in_words(text: str, form: str = "{d}°{m:02d}'{s:011.8f}\"{h}") -> str:
    """A list in degrees, written in degrees, minutes and seconds with the letter of the hemisphere."""
    for name in POINTS:
        x, y, _ = place(name, "EPSG:4326")
        text = text.replace(repr(x), angle(x, "EW", form)).replace(repr(y), angle(y, "NS", form))
    return text


def apart(text: str, sign: str) -> str:
    """A list with a sign between thousands."""
    for x, y, _ in POINTS.values():
        text = text.replace(repr(x), f"{x:,}".replace(",", sign)).replace(repr(y), f"{y:,}".replace(",", sign))
    return text


def gsi() -> str:
    lines = []
    for i, (name, values) in enumerate(POINTS.items(), 1):
        words = " ".join(f"{81 + k}..00+{round(value * 1000):016d}" for k, value in enumerate(values))
        lines.append(f"*11{i:04d}+{name:0>16} {words} ")
    return "\n".join(lines) + "\n"


def landxml() -> str:
    points = "".join(f'<CgPoint name="{name}" code="GCP">{y!r} {x!r} {z!r}</CgPoint>' for name, (x, y, z) in POINTS.items())
    head = '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2"><Units><Metric linearUnit="meter"/></Units>'
    return f'<?xml version="1.0"?>\n{head}<CgPoints name="Control">{points}</CgPoints></LandXML>'


def micmac() -> tuple[str, str]:
    points = "".join(
        f"<OneAppuisDAF><Pt> {x!r} {y!r} {z!r} </Pt><NamePt> {name} </NamePt><Incertitude> 1 1 1 </Incertitude></OneAppuisDAF>"
        for name, (x, y, z) in POINTS.items()
    )
    seen = ""
    for i, photo in enumerate(NAMES):
        own = "".join(
            f"<OneMesureAF1I><NamePt>{name}</NamePt><PtIm>{p[i][0]!r} {p[i][1]!r}</PtIm></OneMesureAF1I>"
            for name, p in PIXELS.items()
        )
        seen += f"<MesureAppuiFlottant1Im><NameIm>{photo}.JPG</NameIm>{own}</MesureAppuiFlottant1Im>"
    head = '<?xml version="1.0" ?>\n'
    wrapped = f"{head}<SetOfMesureAppuisFlottants>{seen}</SetOfMesureAppuisFlottants>"
    return f"{head}<Global><DicoAppuisFlottant>{points}</DicoAppuisFlottant></Global>", wrapped


def opensfm() -> str:
    found = []
    for name, pixels in PIXELS.items():
        x, y, z = place(name, "EPSG:4326")
        seen = [
            {"shot_id": f"{photo}.JPG", "projection": [(col + 0.5 - 400) / 800, (row + 0.5 - 225) / 800]}
            for photo, (col, row) in zip(NAMES, pixels, strict=True)
        ]
        found.append({"id": name, "position": {"latitude": y, "longitude": x, "altitude": z}, "observations": seen})
    return json.dumps({"points": found})


def receiver(system: str, unit: float = 1.0) -> str:
    """The table of a receiver: easting, northing and height of a system, and degrees with heights above the ellipsoid."""
    head = (
        "Name,Code,Easting,Northing,Elevation,Longitude,Latitude,Ellipsoidal height,Easting RMS,Northing RMS,Elevation RMS,CS name"
    )
    lines = [head]
    for name, (x, y, z) in POINTS.items():
        lon, lat, _ = place(name, "EPSG:4326")
        own = [x / unit, y / unit, z / unit, lon, lat, z]
        lines.append(f"{name},,{','.join(map(repr, own))},0.011,0.012,0.018,{system}")
    return "\n".join(lines) + "\n"


def marked_table() -> str:
    return gcp("{name};{x};{y};{z};{photo};{col};{row}", head="Punkt;Rechtswert;Hochwert;Höhe;Foto;Spalte;Zeile")


def comma(text: str) -> str:
    return text.replace(".", ",").replace(",JPG", ".JPG")


def listed(text: str | bytes, **more):
    read = text if isinstance(text, str) else decoded(text, "gcp_list.txt")
    return control_from_list(PHOTOS, read, ControlFromGcpList(kind="gcp_list", path="gcp_list.txt", **more), UTM)


def filed(points: str | bytes, measured: str | None, **more):
    read = points if isinstance(points, str) else decoded(points, "points.csv")
    source = ControlFromFiles(kind="files", points="p", measurements="m" if measured else None, **more)
    return control_from_files(PHOTOS, read, measured, source.crs, UTM, source=source)


def geocentric(text: str) -> str:
    to_space = Transformer.from_crs(CRS(UTM).to_3d(), "EPSG:4978", always_xy=True)
    for x, y, z in POINTS.values():
        text = text.replace(f"{x!r} {y!r} {z!r}", " ".join(map(repr, to_space.transform(x, y, z))))
    return text.replace(UTM, "EPSG:4978")


def feet(text: str) -> str:
    for values in POINTS.values():
        for value in values:
            text = text.replace(repr(value), repr(value / 0.3048))
    return text


US_FEET = "+proj=utm +zone=32 +datum=WGS84 +units=us-ft"
LISTS = {
    "as documented": lambda: listed(gcp()),
    "tabs": lambda: listed(gcp("{x}\t{y}\t{z}\t{col}\t{row}\t{photo}\t{name}")),
    "semicolons": lambda: listed(gcp("{x};{y};{z};{col};{row};{photo};{name}")),
    "commas": lambda: listed(gcp("{x},{y},{z},{col},{row},{photo},{name}")),
    "semicolons and decimal commas": lambda: listed(comma(gcp("{x};{y};{z};{col};{row};{photo};{name}"))),
    "blanks and decimal commas": lambda: listed(comma(gcp())),
    "UTF-8 with a mark": lambda: listed(b"\xef\xbb\xbf" + gcp().encode()),
    "UTF-16": lambda: listed(gcp().encode("utf-16")),
    "Latin-1 in a comment": lambda: listed(gcp().replace(f"{UTM}\n", f"{UTM}\n# Süd, Gerät 2\n").encode("latin-1")),
    "names in small letters": lambda: listed(gcp().replace("DJI", "dji").replace(".JPG", ".jpg")),
    "names without extension": lambda: listed(gcp().replace(".JPG", "")),
    "another extension": lambda: listed(gcp().replace(".JPG", ".TIF")),
    "names with folders": lambda: listed(gcp().replace("DJI_", "C:\\flight\\DJI_")),
    "more words behind the name": lambda: listed(gcp("{x} {y} {z} {col} {row} {photo} {name} 0.02 note")),
    "latitude and longitude": lambda: listed(gcp("{y} {x} {z} {col} {row} {photo} {name}", "EPSG:4326")),
    "longitude and latitude": lambda: listed(gcp(system="EPSG:4326")),
    "northing first": lambda: listed(gcp("{y} {x} {z} {col} {row} {photo} {name}")),
    "another zone": lambda: listed(gcp(system="EPSG:32633")),
    "US survey feet": lambda: listed(gcp(system=US_FEET)),
    "the workflow names the system": lambda: listed(gcp(head="our grid"), crs=UTM),
    "no line with the system, named in the workflow": lambda: listed(gcp(head=""), crs=UTM),
    "the system in a comment": lambda: listed(gcp(head=f"# {UTM}")),
    "EPSG without its colon": lambda: listed(gcp(head="EPSG 32632")),
    "UTM in other words": lambda: listed(gcp(head="WGS 84 UTM 32 N")),
    "WGS84 longlat, latitude first": lambda: listed(gcp("{y} {x} {z} {col} {row} {photo} {name}", "EPSG:4326", "WGS84 longlat")),
    "WKT": lambda: listed(gcp(head=CRS(UTM).to_wkt("WKT1_GDAL"))),
    "a title above the system": lambda: listed(gcp(head=f"Quarry, survey of May\n{UTM}")),
    "names of columns below the system": lambda: listed(gcp(head=f"{UTM}\nX Y Z pixel_x pixel_y image name")),
    "comments of CAD programs": lambda: listed(gcp(head=f"{UTM}\n; surveyed in May\n// by RTK")),
    "name first": lambda: listed(gcp("{name} {x} {y} {z} {col} {row} {photo}")),
    "photograph before its pixel": lambda: listed(gcp("{x} {y} {z} {photo} {col} {row} {name}")),
    "a tab at the end of all lines": lambda: listed(gcp("{x} {y} {z} {col} {row} {photo} {name}\t")),
    "quotes around paths with blanks": lambda: listed(gcp('{x} {y} {z} {col} {row} "C:\\my flight\\{photo}" {name}')),
    "ends of lines of old computers": lambda: listed(gcp().replace("\n", "\r")),
    "UTF-16 without its mark": lambda: listed(gcp().encode("utf-16-le")),
    "UTF-32": lambda: listed(gcp().encode("utf-32")),
    "degrees, minutes and seconds": lambda: listed(in_words(gcp(system="EPSG:4326"))),
    "letters of hemispheres": lambda: listed(in_words(gcp(system="EPSG:4326"), "{h}{d}:{m}:{s:.8f}")),
    "commas between thousands": lambda: listed(apart(gcp(), ",")),
    "apostrophes between thousands": lambda: listed(apart(gcp("{x};{y};{z};{col};{row};{photo};{name}"), "'")),
    "one point in capitals and not": lambda: listed(gcp().replace("DJI_0002.JPG P1", "DJI_0002.JPG p1")),
    "geocentric": lambda: listed(geocentric(gcp())),
}
FILES = {
    "our own": lambda: filed(table(OWN_LINE, OWN), marks()),
    "our own with semicolons": lambda: filed(table(OWN_LINE, OWN).replace(",", ";"), marks().replace(",", ";")),
    "our own with semicolons and decimal commas": lambda: filed(
        table(OWN_LINE, OWN).replace(",", ";").replace(".", ","), comma(marks().replace(",", ";"))
    ),
    "our own in capitals with tabs": lambda: filed(table(OWN_LINE, OWN.upper()).replace(",", "\t"), marks()),
    "easting, northing, height": lambda: filed(table("{name};{y};{x};{z}", "Point;Northing;Easting;Height"), marks()),
    "French": lambda: filed(table("{name};{x};{y};{z}", "Nom;Est;Nord;Altitude"), marks()),
    "Spanish": lambda: filed(table("{name},{x},{y},{z}", "Punto,Este,Norte,Cota"), marks()),
    "header with #": lambda: filed(table("{name},{x},{y},{z}", "#label,x,y,z"), marks()),
    "millimetres by the header": lambda: filed(
        table("{name},{x},{y},{z},20,20,30", "name,x,y,z,sigma_x (mm),sigma_y (mm),sigma_z (mm)"), marks()
    ),
    "millimetres by the workflow": lambda: filed(
        table(OWN_LINE.replace("0.02", "20").replace("0.03", "30"), OWN), marks(), errors_in="mm"
    ),
    "Pix4D": lambda: filed(table("{name},{x},{y},{z},0.02,0.03"), marks("{photo},{name},{col},{row}", "", 0.5)),
    "Pix4D, latitude first": lambda: filed(
        table("{name},{y},{x},{z}", system="EPSG:4326"), marks("{photo},{name},{col},{row},1.5", "", 0.5), crs="EPSG:4326"
    ),
    "degrees that nothing names": lambda: filed(table("{name},{x},{y},{z}", system="EPSG:4326"), marks()),
    "Metashape CSV": lambda: filed(
        table("{name},{x},{y},{z},0.005", "#CoordinateSystem: WGS 84 / UTM zone 32N (EPSG::32632)\n#Label,X,Y,Z,Accuracy_(m)"),
        marks(),
    ),
    "Metashape XML": lambda: filed(markers_xml(), None),
    "Leica with blanks": lambda: filed(table("{name} {x} {y} {z}"), marks()),
    "northing, easting, height, code": lambda: filed(
        table("{name},{y},{x},{z},iron pin", "Point Number,Northing,Easting,Elevation,Description"), marks()
    ),
    "PNEZD without names of columns": lambda: filed(table("{name},{y},{x},{z},iron pin"), marks()),
    "a receiver's table in a system that PROJ knows": lambda: filed(receiver("WGS 84 / UTM zone 32N"), marks()),
    "a receiver's table in feet of a system that nobody knows": lambda: filed(receiver("Site 7 (ftUS)", 0.3048006), marks()),
    "a receiver's table in the system of the workflow": lambda: filed(receiver("Site 7"), marks(), crs=UTM),
    "degrees, minutes and seconds in a table": lambda: filed(
        in_words(table("{name};{y};{x};{z}", "name;lat;lon;z", "EPSG:4326")), marks()
    ),
    "commas between thousands, quoted": lambda: filed(apart(table('{name},"{x}","{y}",{z}', "name,x,y,z"), ","), marks()),
    "measurements of points in small letters": lambda: filed(table("{name},{x},{y},{z}"), marks().replace("\nP", "\np")),
    "titles above the names of columns": lambda: filed(table("{name},{x},{y},{z}", "Quarry 7\nname,x,y,z"), marks()),
    "feet by the names of columns": lambda: filed(feet(table("{name},{x},{y},{z}", "name,x (ft),y (ft),z (ft)")), marks()),
    "targets in images": lambda: filed(
        table("{name},{x},{y},{z},0.005,0.01", "Label,Easting,Northing,Height,Accuracy_Horizontal,Accuracy_Vertical"),
        marks("{photo},{name},{col},{row}", "img_name,target_name,image_x,image_y"),
    ),
    "Leica GSI": lambda: filed(gsi(), marks()),
    "LandXML": lambda: filed(landxml(), marks()),
    "MicMac": lambda: filed(*micmac()),
    "OpenSfM": lambda: filed(opensfm(), None),
    "points beside their measurements": lambda: filed(marked_table(), None),
    "points beside their measurements, decimal commas": lambda: filed(comma(marked_table()), None),
    "UTF-16 with semicolons": lambda: filed(table(OWN_LINE, OWN).replace(",", ";").encode("utf-16"), marks()),
}


@pytest.mark.parametrize("case", [*LISTS, *FILES])
def test_control_is_read_as_it_is(case):
    found = (LISTS | FILES)[case]()
    points = {point.name: point for point in found.points}
    assert list(points) == list(POINTS)
    for name, xyz in POINTS.items():
        # Transformations between WGS 84 and its own grids: a tenth of a millimetre.
        np.testing.assert_allclose(points[name].xyz, xyz, atol=2e-4, err_msg=case)
        assert 0.004 < points[name].sigma[0] < 0.05 and points[name].role == "control"
        for photo, pixel in zip(NAMES, PIXELS[name], strict=True):
            np.testing.assert_allclose(points[name].measurements[photo][:2], pixel, atol=1e-9)
    told = found.read.sentence
    assert told.startswith("Control: ") and "3 points, 6 measurements" in told


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("latitude and longitude", "comes first in their file"),
        ("northing first", "comes first in their file"),
        ("US survey feet", "were taken as feet, too (0.3048006 m)"),
        ("degrees that nothing names", "are degrees, and were read as longitude and latitude"),
        ("Pix4D, latitude first", "comes first in their file"),
    ],
)
def test_what_was_assumed_is_said(case, words):
    found = (LISTS | FILES)[case]()
    assert any(words in finding.sentence for finding in found.findings), found.findings


def test_formats_are_named():
    assert "marks of Pix4D" in FILES["Pix4D"]().read.format and FILES["Pix4D"]().read.corner
    assert FILES["Metashape XML"]().read.format == "Metashape markers (XML)"
    assert FILES["Metashape CSV"]().read.format.startswith("Metashape markers (CSV)")
    assert "Windows-1252" in LISTS["Latin-1 in a comment"]().read.sentence


def test_points_may_have_blanks_in_their_names():
    text = gcp().replace(" P", " GCP ")
    assert [point.name for point in listed(text).points] == ["GCP 1", "GCP 2", "GCP 3"]


def test_photographs_may_have_blanks_in_their_names():
    photos = Photos(photos=tuple(p.model_copy(update={"name": p.name.replace("_", " ")}) for p in PHOTOS.photos))
    text = gcp().replace("DJI_", "DJI ")
    found = control_from_list(photos, text, ControlFromGcpList(kind="gcp_list", path="g"), UTM)
    assert list(found.points[0].measurements) == ["DJI 0001", "DJI 0002"]


@pytest.mark.parametrize(
    ("make", "free"),
    [
        (lambda: listed(gcp("{x} {y} NaN {col} {row} {photo} {name}")), "have no height"),
        (lambda: listed(gcp("{x} {y} {col} {row} {photo} {name}")), "have no height"),
        (lambda: listed(gcp("{x};{y};;{col};{row};{photo};{name}")), "have no height"),
        (lambda: listed(gcp("{x} {y} 0 {col} {row} {photo} {name}")), "the height 0, which was taken as unknown"),
        (lambda: filed(table("{name};{x};{y};", "name;x;y;z"), marks()), ""),
        (lambda: filed(table("{name},{x},{y},nan", "name,x,y,z"), marks()), "have no height"),
    ],
)
def test_heights_that_are_not_known_hold_nothing(make, free):
    if not free:
        with pytest.raises(OrthomillError, match=r"line 2, point P1: z is '', which must be a number \(or NaN\)"):
            make()
        return
    found = make()
    assert [point.sigma[2] for point in found.points] == [NO_HEIGHT] * 3 and [p.sigma[0] for p in found.points] == [0.03] * 3
    assert any(free in finding.sentence for finding in found.findings)
    np.testing.assert_allclose(found.points[0].xyz[:2], POINTS["P1"][:2])


def test_check_points_without_heights_check_nothing():
    found = listed(gcp("{x} {y} NaN {col} {row} {photo} {name}"), check=("P2",))
    assert [point.name for point in found.points] == ["P1", "P3"]
    assert "P2, as check points, were left out" in found.findings[0].sentence


PHOTOS_ABSENT = "None of the photographs that control points are measured in is in the project"
ENTITIES = "<!DOCTYPE d [<!ENTITY a 'b'>]><document"
REFUSED = [
    (lambda: listed(gcp(head="")), "names no reference system: line 1 is a measurement"),
    (
        lambda: listed(gcp().replace("391040.5 ", "391040.5.1 ")),
        r"list, line 4: '391040\.5\.1 .* must hold X Y Z col row photograph",
    ),
    (lambda: listed(b"\x00\x01" + gcp().encode()), "holds NUL bytes"),
    (lambda: listed(gcp().replace("DJI_", "IMG_")), PHOTOS_ABSENT),
    (lambda: listed(gcp(head="WGS84 UTM 32")), "'WGS84 UTM 32' of the control points is not known"),
    (lambda: filed(table(OWN_LINE, OWN).replace(".", ","), marks()), "line 2: 14 cells, but the first line names 8 columns"),
    (
        lambda: filed(table(OWN_LINE.replace("0.0", "20.0"), OWN), marks()),
        r"standard errors of 20\.02, 20\.02, 20\.03.*errors_in: mm",
    ),
    (
        lambda: filed(marked_table().replace("P3;390970.75", "P3;390970.85", 1), None),
        r"line 7: point P3 has other coordinates than in line 6",
    ),
    (lambda: filed(table("{name},{x},{y},{z}", "name,x,y,z"), None), "come without measurements in photographs"),
    (lambda: filed(table("{name},{x}", "name,x"), marks()), r"lacks the column\(s\) y"),
    (lambda: filed(b"PK\x03\x04 and so on", marks()), r"points.csv is a spreadsheet \(.xlsx, .ods\).*CSV"),
    (lambda: filed(b"\x00\x00\x27\x0a", marks()), "is a shapefile; export its points"),
    (lambda: filed('<?xml version="1.0"?>\n<kml xmlns="x"></kml>', marks()), "is a KML file, .* export its points"),
    (lambda: filed('<?xml version="1.0"?>\n<gpx></gpx>', marks()), "is a GPX file of a navigation receiver"),
    (lambda: filed('{"type": "FeatureCollection"}', marks()), "is a GeoJSON file"),
    (lambda: filed("<?xml version='1.0'?><BlocksExchange/>", marks()), "is a block of ContextCapture"),
    (lambda: listed("<!DOCTYPE html><html>404</html>"), "is a web page"),
    (lambda: filed("", marks()), "The control points file is empty"),
    (lambda: filed(landxml().replace("meter", "furlong"), marks()), "in the unit 'furlong', which is not known"),
    (lambda: filed(landxml().replace("391040.5 ", "391o40 "), marks()), "point P2: '4987055.75 391o40 303.25' must hold northing"),
    (lambda: filed(gsi().replace("81..00", "81..05"), marks()), "line 1, point P1: the word 81 cannot be read"),
    (lambda: filed("110001+000000P1 21.102+19723700 31..00+00045179\n", marks()), "holds measurements, but no coordinates"),
    (lambda: filed(micmac()[1], micmac()[1]), "MicMac. holds no points"),
    (lambda: filed(micmac()[0].replace("<Global>", "<!DOCTYPE d [<!ENTITY a 'b'>]><Global>"), marks()), "it defines entities"),
    (lambda: filed(opensfm().replace('"id"', '"name"'), None), "is no ground_control_points.json .*KeyError: 'id'"),
    (lambda: listed(gcp().replace("391040.5 ", "3.91E+05 ")), "line 4: '3.91E\\+05', which a spreadsheet has cut"),
    (lambda: filed(table("{name},{x},{y},{z}").replace("391000.125", "3.91E+05"), marks()), "P1: x is '3.91E.05', .* has cut"),
    (
        lambda: listed(gcp().replace("391040.5 4987055.75 303.25 611.5", "391040.6 4987055.75 303.25 611.5")),
        "line 5: point P2 has the coordinates 391040.6 4987055.75 303.25, but others in an earlier line",
    ),
    (lambda: filed(table("{name};{x};{y};{z}", "name;x;y;z").replace("391000.125", "391.000;5"), marks()), "line 2: 5 cells"),
    (lambda: filed(markers_xml().replace("<document", ENTITIES), None), "it defines entities"),
    (lambda: filed(markers_xml()[:-20], None), "is no XML that can be read"),
    (lambda: filed(markers_xml("false"), None), "is measured in no photograph"),
    (
        lambda: filed(table(OWN_LINE, OWN), marks().replace("620.0", "1_0")),
        "line 4, point P2: col is '1_0', which must be a number",
    ),
]


@pytest.mark.parametrize(("make", "sentence"), REFUSED)
def test_what_cannot_be_right_is_refused_with_its_line(make, sentence):
    with pytest.raises(OrthomillError, match=sentence):
        make()


CHECKED = {
    "Metashape CSV": lambda: filed(
        table("{name},1,{x},{y},{z},0.005", "#Label,Enable,X,Y,Z,Accuracy_(m)").replace("P3,1", "P3,0"), marks()
    ),
    "Metashape XML": lambda: filed(markers_xml().replace('<reference x="390970.75"', '<reference enabled="0" x="390970.75"'), None),
    "a column of types": lambda: filed(
        table("{name},{x},{y},{z},GCP", "name,x,y,z,type").replace("125,GCP", "125,Check point"), marks()
    ),
    "CP beside GCP": lambda: filed(table("{name},{x},{y},{z},GCP", "name,x,y,z,type").replace("125,GCP", "125,CP"), marks()),
    "the workflow": lambda: filed(table("{name},{x},{y},{z},GCP", "name,x,y,z,type"), marks(), check=("P3",)),
    "OpenSfM": lambda: filed(opensfm().replace('"id": "P3"', '"role": "metrics_only", "id": "P3"'), None),
}


@pytest.mark.parametrize("case", CHECKED)
def test_check_points_of_other_programs_are_none_of_the_control(case):
    found = CHECKED[case]()
    assert {point.name: point.role for point in found.points} == {"P1": "control", "P2": "control", "P3": "check"}
    assert "(1 of them check points)" in found.read.sentence


def test_types_that_are_no_roles_tell_nothing():
    found = filed(table("{name},{x},{y},{z},concrete", "name,x,y,z,type"), marks())
    assert [point.role for point in found.points] == ["control"] * 3


@pytest.mark.parametrize(
    ("make", "sigma", "said"),
    [
        (
            lambda: listed(gcp("{x:.0f} {y:.0f} {z:.0f} {col} {row} {photo} {name}")),
            (0.29, 0.29),
            "coordinates to 1 m and heights to 1 m",
        ),
        (lambda: listed(gcp("{x:.5f} {y:.5f} {z} {col} {row} {photo} {name}", "EPSG:4326")), (0.32, 0.05), "coordinates to 1.1 m:"),
        (lambda: filed(table("{name},{x:.0f},{y:.0f},{z}", "name,x,y,z"), marks()), (0.29, 0.05), "coordinates to 1 m:"),
        # The degrees of a small site have three different words: that all end after three decimals says enough.
        (lambda: listed(gcp("{x:.3f} {y:.3f} {z} {col} {row} {photo} {name}", "EPSG:4326")), (32.1, 0.05), "coordinates to 110 m:"),
    ],
)
def test_rounded_coordinates_are_no_better_than_their_rounding(make, sigma, said):
    """0.29 m: the standard deviation of a metre, by the square root of 12."""
    found = make()
    assert found.points[0].sigma[0] == pytest.approx(sigma[0], abs=0.01)
    assert found.points[0].sigma[2] == pytest.approx(sigma[1], abs=0.01)
    (told,) = [finding for finding in found.findings if finding.code == "coordinates_rounded"]
    assert said in told.sentence


def test_mistakes_of_points_are_told_once():
    with pytest.raises(OrthomillError) as refused:
        filed(table("{name},{x},{y},{z}", "name,x,y,z").replace("391000.125", "39l000"), marks())
    assert str(refused.value) == "Control points file, line 2, point P1: x is '39l000', which must be a number."


def test_pixels_of_larger_photographs_are_divided_by_a_plain_factor():
    more = gcp(k=5.0) + "391010 4987050 300 3990 2240 DJI_0001.JPG P9\n391010 4987050 300 3900 2000 DJI_0002.JPG P9\n"
    found = listed(more)
    np.testing.assert_allclose(found.points[0].measurements["DJI_0001"][:2], PIXELS["P1"][0], atol=1e-6)
    (finding,) = found.findings
    assert finding.factor == 5.0 and "divided by 5" in finding.sentence


def test_a_wrong_line_is_no_reduction():
    with pytest.raises(OrthomillError, match="col 3990, row 20, outside of DJI_0001"):
        listed(gcp() + "391010 4987050 300 3990 20 DJI_0001.JPG P9\n391010 4987050 300 30 20 DJI_0002.JPG P9\n")


def test_heights_in_feet_above_all_cameras_are_named():
    found = listed(gcp().replace(" 301.5 ", " 989.17 ").replace(" 303.25 ", " 994.91 ").replace(" 299.125 ", " 981.38 "))
    assert "their heights seem to be in feet" in found.findings[0].sentence


@pytest.mark.parametrize(("given", "fits"), [("EPSG:23032", "WGS 84"), ("EPSG:32632", None)])
def test_another_datum_is_named(given, fits):
    """WGS 84 coordinates said to be in ED50: 200 m off, which the photographs of the points show."""
    text = gcp().replace(UTM, given)
    photos = Photos(photos=tuple(p.model_copy(update={"position": (391003.0, 4987048.0, 350.0)}) for p in PHOTOS.photos))
    found = control_from_list(photos, text, ControlFromGcpList(kind="gcp_list", path="g"), UTM)
    codes = [finding.code for finding in found.findings]
    assert codes == (["datum_apart"] if fits else [])
    if fits:
        assert fits in found.findings[0].fits and 150 < found.findings[0].distance_m < 250
        assert "state it (control > crs)" in found.findings[0].sentence


def test_distances_are_those_of_the_map():
    """In the middle of a UTM zone 0.9996, less 5e-5 for 300 m of height."""
    middle = {name: (500000.0 + i, 4987000.0 + 30 * i, 300.0) for i, name in enumerate(POINTS)}
    text = OWN + "\n" + "".join(f"{n},{'tie' if n == 'P3' else 'control'},{x},{y},{z},1,1,1\n" for n, (x, y, z) in middle.items())
    text = text.replace(f"P3,tie,{middle['P3'][0]},{middle['P3'][1]},{middle['P3'][2]},1,1,1", "P3,tie,,,,,,")
    photos = Photos(photos=tuple(p.model_copy(update={"position": (500010.0, 4987030.0, 350.0)}) for p in PHOTOS.photos))
    lengths = "from,to,metres,sigma\nP1,P2,100,0.01\nP1,P3,100,0.01\n"
    found = control_from_files(photos, text, marks(), None, UTM, lengths)
    assert [d.length for d in found.distances] == pytest.approx([99.9553, 99.9553], abs=2e-4)
    # Marks are written as files of control, which are put on the map when they are read.
    assert [d.measured for d in found.distances] == [d.length for d in marks_of(found).distances] == [100.0, 100.0]


def test_distances_of_a_local_system_stay():
    text = OWN + "\nP1,control,0,0,1,1,1,1\nP2,control,0,30,2,1,1,1\nP3,control,40,0,1,1,1,1\n"
    photos = Photos(photos=tuple(p.model_copy(update={"position": None}) for p in PHOTOS.photos))
    found = control_from_files(photos, text, marks(), None, "EPSG:3857", "from,to,metres,sigma\nP1,P2,30.02,0.01\n")
    assert found.distances[0].length == 30.02 and found.findings == ()


def test_control_on_a_web_map_is_refused_with_its_scale():
    photos = Photos(photos=tuple(p.model_copy(update={"position": None}) for p in PHOTOS.photos))
    with pytest.raises(OrthomillError, match=r"1\.41\d times as large as the ground.*EPSG:32632"):
        control_from_list(photos, gcp(), ControlFromGcpList(kind="gcp_list", path="g"), "EPSG:3857")
