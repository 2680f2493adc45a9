"""The command lines of the documentation, typed beside a finished project and the files that they name."""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from documentation import PAGES, ROOT, commands
from simulated_run import PROJECT
from small_site import command
from typer.testing import CliRunner

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.export.vectors.geopackage import well_known_binary

pytestmark = pytest.mark.slow

NAMES = re.compile(r"^(site|brighton|delivery|house|volos|PROJECT)$")
"""names of projects in the documentation"""
STAND_INS = {
    "FORMAT": "cog",
    "RASTER": "densification/height",
    "PHOTO": "photographs/volos_1_1.tif",
    "POINTS": "points.txt",
    "PIXELS": "pixels.txt",
    "site_photos/DJI_0001.JPG": "photographs/volos_1_1.tif",
    "IMG_1": "volos_1_1",
    "IMG_2": "volos_1_2",
    "A": "volos_1_1",
    "B": "volos_1_2",
    "EPSG:25832": "EPSG:32634",
    "EPSG:26915": "EPSG:32634",
}
MISSED = 3
"""exit code of `accept` where a clause is missed or cannot be tested"""
ELSEWHERE = {
    r"orthomill \w+( --\w+)?|orthomill inspect window-size|orthomill cluster": "names a command and types none",
    r"orthomill accept PROJECT .*": "names a command and types none",
    r"orthomill (run|plan|clean|init|doctor) .*": "tests/end_to_end/test_simulated_project.py",
    r"orthomill (view|watch|dashboard) .*": "tests/pipeline/watching",
    r"orthomill mark .*": "tests/pipeline/serving/test_marking_page.py",
    r"orthomill serve .*": "tests/pipeline/serving",
    r"orthomill calibrate .*": "tests/pipeline/cli/test_calibrate_command.py",
    r"orthomill grow .*": "tests/pipeline/cli",
    r"orthomill (check|change) .*": "tests/pipeline/cli/test_check_command.py",
    r".* --sheets (linz:5000|doqq)": "tests/pipeline/export/test_cutlines_and_sheets.py",
}
"""what is typed by other tests, or stands for nothing that can be typed"""
TYPED = sorted({line for page in PAGES for line in commands(page) if not any(re.fullmatch(one, line) for one in ELSEWHERE)})


@pytest.fixture(scope="module")
def world(run, tmp_path_factory) -> Path:
    """A folder with a copy of the finished project and every file that the documentation names."""
    root = tmp_path_factory.mktemp("world") / "root"
    shutil.copytree(run.root, root)
    products, made = root / "runs" / PROJECT / "products", root / "runs" / PROJECT
    shutil.copytree(made / "photographs", root / "photographs", ignore=shutil.ignore_patterns("*.csv"))
    copies = {"model.tif": "dsm.tif", "theirs.tif": "dsm.tif", "ortho.tif": "ortho.tif", "cameras.json": "cameras.json"}
    for name, source in {**copies, "scan.laz": "points.laz", "cloud.laz": "points.laz"}.items():
        shutil.copy(products / source, root / name)
    for name, source in {"points.csv": "control.csv", "marks.csv": "measurements.csv"}.items():
        shutil.copy(made / "photographs" / source, root / name)
    (root / "points.txt").write_text("A 408000 4357000 30\nvolos_1_1\n")
    (root / "pixels.txt").write_text("300 300\n")
    with (root / "workflows" / f"{PROJECT}.yaml").open("a") as workflow:
        workflow.write("acceptance: {kind: asprs_2023, plan: 0.3, height: 0.3}\n")
    _write_polygons(root)
    return root


def _write_polygons(root: Path) -> None:
    """A parcel and two sheets inside of the town, as the files that the documentation names."""
    pyogrio = pytest.importorskip("pyogrio")
    x, y = 408000.0, 4357000.0
    rings = [np.array([[a, y, 0], [a + 60, y, 0], [a + 60, y + 60, 0], [a, y + 60, 0], [a, y, 0]]) for a in (x - 60, x)]
    names = np.array(["west", "east"], object)
    shapes = np.array([well_known_binary(ring, 1003) for ring in rings], object)
    for file in ("parcel.gpkg", "index.gpkg", "fields.gpkg", "parcel.geojson"):
        pyogrio.raw.write(root / file, shapes, [names], ["name"], geometry_type="Polygon Z", crs="EPSG:2100")


def typed(line: str) -> list[str]:
    """The words of a command line, with the names of this folder in place of those of the documentation."""
    words = [PROJECT if NAMES.match(word) else STAND_INS.get(word, word) for word in shlex.split(line.split(" > ")[0])[1:]]
    if words[0] == "monoplot":
        words[2] = "volos_1_1"
    if words[0] == "accept" and "--ortho" in words:
        words[words.index("--ortho") + 1] = "ortho.tif"
    return words


@pytest.mark.parametrize("line", sorted(TYPED, key=lambda line: "verify" in line))
def test_a_command_of_the_documentation_does_its_work(world, monkeypatch, line):
    """It ends with 0; that a clause is missed is an answer of `accept` as well."""
    monkeypatch.chdir(world)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(world / "settings"))
    words = typed(line)
    ended = CliRunner().invoke(app, words, input="y\n")
    assert "Traceback" not in ended.output and ended.output.strip(), line
    assert ended.exit_code in ((0, MISSED) if words[0] == "accept" else (0,)), f"{line}: {ended.output}"


def test_a_run_with_a_profile_holds_itself_against_it(world, monkeypatch):
    monkeypatch.chdir(world)
    said = command("run", PROJECT)
    page = world / "runs" / PROJECT / "acceptance.html"
    assert "0 jobs run" in said and "is not complete by asprs_2023" in said and str(page.name) in said
    assert "ASPRS Positional Accuracy Standards" in page.read_text()
    before = page.read_bytes()
    told = command("run", PROJECT, "--json")
    assert page.read_bytes() == before, "nothing has changed, and what was signed still holds"
    event = json.loads(told[told.index('{"event": "acceptance"') :])
    assert not event["complete"] and event["text"] in said and event["page"] == str(page)


def test_a_run_that_ends_before_its_products_says_that_it_was_not_judged(world, monkeypatch):
    monkeypatch.chdir(world)
    page = world / "runs" / PROJECT / "acceptance.html"
    before = page.read_bytes() if page.exists() else None
    said = command("run", PROJECT, "--until", "orientation")
    assert "Acceptance by asprs_2023 was not judged: the run ended with orientation" in said and "texture, " in said
    told = command("run", PROJECT, "--until", "orientation", "--json")
    event = json.loads(told[told.index('{"event": "acceptance"') :])
    assert (event["event"], event["complete"]) == ("acceptance", None) and event["text"] in said
    assert (page.read_bytes() if page.exists() else None) == before


def test_what_is_left_to_other_tests_is_tested_there():
    missing = [place for place in ELSEWHERE.values() if place.startswith("tests/") and not (ROOT / place).exists()]
    assert not missing and len(TYPED) > 45
