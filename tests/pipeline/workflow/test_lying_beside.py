"""`orthomill init` uses what lies beside the photographs, and says so."""

import json
import re

import pytest
from front_door import CATALOGUE, photograph

from orthomill.pipeline.workflow.lying_beside import look_beside
from orthomill.pipeline.workflow.starting_workflow import write_starting_workflow
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.project import ANY_CRS

LINE = "340607.768 548220.879 70.8 20 30 a.jpg\n"
POSITIONS = "photo,x,y,z,sigma_x,sigma_y,sigma_z\na,1,2,3,0.1,0.1,0.1\n"
CAMERA = {"name": "cam", "width": 64, "height": 48, "c": 60.0}


@pytest.fixture
def root(tmp_path):
    for name in "ab":
        photograph(tmp_path / "site" / "photos" / f"{name}.jpg", "Canon A3300", focal=5.0)
    return tmp_path


def started(root):
    start = write_starting_workflow("site", root / "site" / "photos", root, CATALOGUE)
    return load_workflow(start.path, CATALOGUE).project, " ".join(start.notes)


@pytest.mark.parametrize("place", ["site/photos", "site"])
@pytest.mark.parametrize(
    ("system", "crs"),
    [
        ("EPSG:2180", "EPSG:2180"),
        ("WGS84 UTM 34N", "EPSG:32634"),
        ("wgs84 utm 34s", "EPSG:32734"),
        ("+proj=utm +zone=11 +ellps=WGS84 +datum=WGS84 +units=m +no_defs\t", "EPSG:32611"),
    ],
)
def test_a_gcp_list_gives_control_and_crs(root, place, system, crs):
    (root / place / "gcp_list.txt").write_text(f"# control\n{system}\n{LINE}")
    project, notes = started(root)
    assert project.crs == crs and project.control.kind == "gcp_list"
    assert project.control.path == f"{place}/gcp_list.txt" and "gcp_list.txt lies beside" in notes
    assert "local system" not in notes and "Fill in 'crs'" not in notes


@pytest.mark.parametrize("system", ["EPSG:4326", "EPSG:2263", "somewhere", "WGS84 UTM xN"])
def test_a_list_in_degrees_feet_or_an_unknown_system_leaves_the_crs_open(root, system):
    (root / "site" / "gcp_list.txt").write_text(f"{system}\n{LINE}")
    start = write_starting_workflow("site", root / "site" / "photos", root, CATALOGUE)
    assert "\ncrs:  # to be filled in" in start.path.read_text() and any("Fill in 'crs'" in note for note in start.notes)


def test_a_system_that_proj_does_not_know_is_asked_for(root):
    (root / "site" / "gcp_list.txt").write_text(f"PUWG1992\n{LINE}")
    start = write_starting_workflow("site", root / "site" / "photos", root, CATALOGUE)
    assert "\n  crs:  # to be filled in, e.g. EPSG:32634: 'PUWG1992' is not known to PROJ" in start.path.read_text()
    assert "Fill in 'control > crs': PROJ does not know the system 'PUWG1992' that site/gcp_list.txt names." in start.notes


def test_a_list_without_a_system_asks_for_it(root):
    (root / "site" / "gcp_list.txt").write_text(LINE + LINE.replace("a.jpg", "b.jpg"))
    start = write_starting_workflow("site", root / "site" / "photos", root, CATALOGUE)
    assert "\n  crs:  # to be filled in, e.g. EPSG:32634: the list names none" in start.path.read_text()
    assert "Fill in 'control > crs': site/gcp_list.txt names no reference system." in start.notes


def test_positions_and_a_calibration_are_used(root):
    (root / "site" / "rtk.csv").write_text(POSITIONS)
    (root / "site" / "photos" / "camera.json").write_text(json.dumps(CAMERA))
    (root / "site" / "gcp_list.txt").write_text(f"EPSG:2180\n{LINE}")
    project, notes = started(root)
    assert (project.positions.kind, project.positions.path) == ("file", "site/rtk.csv")
    assert (project.cameras.kind, project.cameras.path) == ("file", "site/photos/camera.json")
    assert "used for the positions" in notes and "used for the camera" in notes


def test_photographs_of_which_nothing_is_known_get_a_local_system(root):
    project, notes = started(root)
    assert project.crs == ANY_CRS and project.control.kind == "none" and "local system" in notes


def test_other_files_are_no_finds(root):
    folder = root / "site" / "photos"
    (folder / "gcp_list.txt").write_text("EPSG:2180")
    (folder / "notes.csv").write_text("a,b\n1,2\n")
    (folder / "empty.csv").write_text("")
    (folder / "list.json").write_text("[1, 2]")
    (folder / "broken.json").write_text("{")
    (folder / "other.json").write_text(json.dumps(CAMERA | {"width": 4000}))
    (folder / "latin.csv").write_bytes(b"photo,x\xff")
    found = look_beside(folder, root, {(64, 48)})
    said = "site/photos/gcp_list.txt is control or positions by its name, but follows no format that is known: it is not used."
    assert found == type(found)(unused=(said,))


def test_nothing_outside_of_the_project_is_used(root):
    (root / "gcp_list.txt").write_text(f"EPSG:2180\n{LINE}")
    top = root / "site"
    assert look_beside(top, top, set()).gcp_list is None


def found(root, photographs=("a", "b")):
    return look_beside(root / "site" / "photos", root, set(), photographs)


@pytest.mark.parametrize("data", [f"EPSG:2180\n{LINE}".encode("utf-16"), f"EPSG:2180\n# Süd\n{LINE}".encode("latin-1")])
def test_a_gcp_list_of_windows_is_used(root, data):
    (root / "site" / "gcp_list.txt").write_bytes(data)
    project, _ = started(root)
    assert project.crs == "EPSG:2180" and project.control.kind == "gcp_list"


def test_a_list_of_control_of_any_name_is_recognised_by_its_lines(root):
    (root / "site" / "targets May.txt").write_text(f"EPSG:2180\n{LINE}{LINE}")
    project, notes = started(root)
    assert project.control.path == "site/targets May.txt" and "(GCP list of OpenDroneMap)" in notes


@pytest.mark.parametrize(
    ("points", "marks"),
    [
        (
            "name;Easting;Northing;Height\nP1;340607,7;548220,8;70,8\nP2;340617,7;548220,8;70,8\n",
            "a.JPG,P1,20,30\nb.JPG,P1,21,30\n",
        ),
        ("P1,340607.768,548220.879,70.8\nP2,340617.768,548220.879,70.8\n", "name,photo,col,row,sigma\nP1,a,2,3,1\n"),
        ("#Label,X,Y,Z\nP1,340607.768,548220.879,70.8\n#end\nP2,340617.7,548220.8,70.8\n", "a.JPG,P1,20,30\nb.JPG,P2,21,30\n"),
    ],
)
def test_points_and_their_marks_are_used_together(root, points, marks):
    (root / "site" / "survey.csv").write_text(points)
    (root / "site" / "photos" / "clicked.txt").write_text(marks)
    beside = found(root)
    assert (beside.points, beside.marks, beside.positions) == ("site/survey.csv", "site/photos/clicked.txt", None)
    text = write_starting_workflow("site", root / "site" / "photos", root, CATALOGUE).path.read_text()
    assert "  kind: files  # found beside the photographs" in text and "measurements: site/photos/clicked.txt" in text


@pytest.mark.parametrize(
    ("name", "text", "form"),
    [
        ("geo.txt", "EPSG:32615\na.jpg 576682.7 5188183.7 198.6\nb.jpg 576691.9 5188193.6 198.6\n", "geo.txt of OpenDroneMap"),
        ("pix.csv", "a.jpg,46.23,6.56,539.9\nb.jpg,46.24,6.56,529.8\n", "Pix4D geolocation"),
        (
            "ref.txt",
            "#Label,Longitude,Latitude,Altitude\nA.JPG,6.56,46.23,539.9\nB.JPG,6.57,46.23,539.9\n",
            "table with named columns",
        ),
        (
            "x_Timestamp.MRK",
            "".join(f"{n}\t1\t[2262]\t 1,N\t 2,E\t 3,V\t46.2,Lat\t6.5,Lon\t539.9,Ellh\t0.1, 0.1, 0.1\t50,Q\n" for n in (1, 2)),
            "DJI time marks (.MRK)",
        ),
    ],
)
def test_positions_of_programs_are_used(root, name, text, form):
    (root / "site" / name).write_text(text)
    project, notes = started(root)
    assert project.positions.path == f"site/{name}" and form in notes
    assert project.crs == ("EPSG:32615" if name == "geo.txt" else "EPSG:32632"), "of the file, or the zone of its degrees"


@pytest.mark.parametrize("text", [POSITIONS.replace("a,1", "DJI_1,1"), "name,X,Y,Z\nDJI_1.JPG,1,2,3\nDJI_2.JPG,2,3,4\n"])
def test_positions_of_other_photographs_are_not_used_and_named(root, text):
    (root / "site" / "gnss.csv").write_text(text)
    beside = found(root)
    assert beside.positions is None
    assert beside.unused == (
        "site/gnss.csv holds positions (table with named columns), but names 0 of the 2 photographs: it is not used.",
    )


def test_a_web_map_is_refused_where_photographs_have_places(root):
    photograph(root / "site" / "photos" / "c.jpg", "Canon A3300", focal=5.0, gps=(-91.99, 46.84))
    with pytest.raises(WorkflowError, match=r"1\.46\d times as large as the ground.*EPSG:32615"):
        write_starting_workflow("site", root / "site" / "photos", root, CATALOGUE, "EPSG:3857")


GCP = f"EPSG:2180\n{LINE}{LINE.replace('a.jpg', 'b.jpg')}"
SURVEYED = "name,x,y,z\nP1,340607.7,548220.8,70.8\nP2,340617.7,548220.8,70.8\n"
MARKED = "name,photo,col,row,sigma\nP1,a,2,3,1\nP2,b,4,3,1\n"
NAMED = "photo,lon,lat,z\na,17.1,52.8,170\nb,17.2,52.8,170\n"
TIMES = "".join(f"2023/05/17 08:15:0{n}.0 52.8 17.1 170.0 1 12 0.01 0.01 0.02\n" for n in (1, 2))


@pytest.mark.parametrize(
    ("files", "used", "said"),
    [
        ({"gcp_list.txt": GCP.replace("a.jpg", "x.jpg").replace("b.jpg", "y.jpg")}, None, "names none of these photographs"),
        (
            {"gcp_list.txt": GCP, "old.txt": GCP},
            "site/gcp_list.txt",
            "site/old.txt holds control .*, but site/gcp_list.txt is used",
        ),
        ({"survey.csv": SURVEYED}, None, r"holds 2 points \(control points\), but no file says where they are in the photographs"),
        ({"clicked.csv": MARKED}, None, "no file holds the coordinates of its points"),
        ({"survey.csv": SURVEYED, "clicked.csv": MARKED.replace("P", "p")}, "site/survey.csv", ""),
        ({"gcp.csv": "these are\nnotes of May\n"}, None, "gcp.csv is control or positions by its name, but follows no format"),
        ({"gcps.xlsx": b"PK\x03\x04"}, None, r"Not used: site/gcps.xlsx is a spreadsheet .*CSV"),
        ({"gcps.csv": b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"}, None, "Not used: site/gcps.csv is a spreadsheet of Excel 97"),
        ({"site.kml": "<kml xmlns='x'/>"}, None, "Not used: site/site.kml is a KML file"),
        ({"site.dxf": "  0\nSECTION\n  2\nENTITIES\n"}, None, r"Not used: site/site.dxf is a drawing \(DXF\)"),
        ({"points.geojson": '{"type": "FeatureCollection"}'}, None, "Not used: site/points.geojson is a GeoJSON file"),
        (
            {"marked.csv": "Punkt;Rechtswert;Hochwert;Höhe;Foto;Spalte;Zeile\nP1;340607,7;548220,8;70,8;a.jpg;2,5;3\n"},
            "site/marked.csv",
            "",
        ),
        ({"titled.txt": f"Survey of May\n{GCP}"}, "site/titled.txt", ""),
        ({"named.txt": GCP.replace("340607.768", "P1 340607.768")}, "site/named.txt", ""),
        (
            {"targets.gsi": "*110001+00000000000000P1 81..00+0000000340607768 82..00+0000000548220879\n"},
            None,
            "1 points .Leica GSI.",
        ),
        ({"p.xml": "<?xml?><LandXML><CgPoints><CgPoint name='P1'>1 2 3</CgPoint></CgPoints></LandXML>"}, None, "points .LandXML."),
        (
            {"ground_control_points.json": '{"points": [{"id": "P1", "observations": [{"shot_id": "a.jpg"}]}]}'},
            "site/ground_control_points.json",
            "",
        ),
        ({"xyz.txt": "".join(f"{n} {n}.5 2.5 3.5\n" for n in range(1000))}, None, ""),
        ({"cam.json": '{"all": {"projection_type": "brown", "focal_x": 0.58}}'}, None, "a camera of OpenSfM or OpenDroneMap"),
        ({"cam.xml": "<?xml?>\n<calibration>\n  <projection>frame</projection>"}, None, r"a camera of Metashape \(Agisoft\)"),
        ({"cam.yml": "%YAML:1.0\ncamera_matrix: !!opencv-matrix\n"}, None, "a camera of OpenCV, .*kind: given"),
        ({"K.txt": "1955.65 0 780.9\n0.0 1955.65 638.5\n0 0 1.0\n"}, None, "a program that writes its matrix K"),
    ],
)
def test_control_is_used_or_named(root, files, used, said):
    for name, content in files.items():
        (root / "site" / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    beside = found(root)
    assert beside.control == used
    assert re.search(said, " ".join(beside.unused)) if said else beside.unused == (), beside.unused


@pytest.mark.parametrize(
    ("files", "used", "said"),
    [
        (
            {"a.csv": NAMED.rpartition("b,")[0], "b.csv": NAMED},
            "site/b.csv",
            "a.csv holds positions as well .*, but site/b.csv is used",
        ),
        ({"a_events.pos": TIMES, "named.csv": NAMED}, "site/named.csv", "a_events.pos holds positions as well"),
        ({"a_events.pos": TIMES}, "site/a_events.pos", ""),
        ({"track.pos": TIMES * 20}, None, "track.pos holds positions .*, but has 40 exposures without names for 2 photographs"),
        ({"geo.txt": "WGS84 UTM 34N\na 340607.7 548220.8 70.8\nb 340617.7 548220.8 70.8\n"}, "site/geo.txt", ""),
        ({"titled.csv": f"Flight 3\n{NAMED}"}, "site/titled.csv", ""),
        ({"plain.csv": "a,52.8,17.1,170\nb,52.8,17.2,170\n"}, "site/plain.csv", ""),
        ({"bilder.csv": "Bild;Rechtswert;Hochwert;Höhe\na;500,1;600,2;70,5\nb;510,1;600,2;70,5\n"}, "site/bilder.csv", ""),
        ({"odd.csv": "what;where\na;here\nb;there\n"}, None, "odd.csv names 2 of the photographs, but follows no format"),
    ],
)
def test_positions_are_used_or_named(root, files, used, said):
    for name, content in files.items():
        (root / "site" / name).write_text(content)
    beside = found(root)
    assert beside.positions == used
    assert re.search(said, " ".join(beside.unused)) if said else beside.unused == (), beside.unused


@pytest.mark.parametrize("head", ["photo,longitude,latitude,z", "#Label,X/Longitude,Y/Latitude,Z/Altitude"])
def test_degrees_in_a_positions_file_tell_the_site_also_where_they_are_exchanged(root, head):
    (root / "site" / "positions.csv").write_text(f"{head}\na,46.8,-91.9,190\nb,46.9,-91.9,190\n")
    assert found(root).site == (-91.9, 46.8)
