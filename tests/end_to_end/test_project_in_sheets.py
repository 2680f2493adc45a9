"""The shipped project `volos_small` with a bound that puts its rasters in sheets: the same pixels, and every command finds them."""

import json
import re
import shutil
from pathlib import Path
from urllib.parse import unquote

import pytest
import rasterio
from simulated_run import PROJECT, Run
from small_site import command, command_in

pytestmark = pytest.mark.slow

MISSED = 3
"""exit code of `accept`: there are too few check points"""


@pytest.fixture(scope="module")
def sheeted(run, tmp_path_factory):
    """A copy of the finished project, run again with the bound."""
    root = tmp_path_factory.mktemp("sheeted") / "copy"
    shutil.copytree(run.root, root)
    workflow = root / "workflows" / f"{PROJECT}.yaml"
    workflow.write_text(workflow.read_text() + "\nsheets_above: 0.0001\n")
    return Run(root, command_in(root, "run", PROJECT, "--sequential"))


def rasters(folder: Path, ending: str) -> set[str]:
    return {path.stem for path in (folder / "products").glob(f"*{ending}")}


def test_only_files_are_made_again_and_the_old_ones_are_said_to_go(run, sheeted):
    assert "Written in another form than before, by sheets_above, and the old files removed: products/" in sheeted.said
    large = rasters(sheeted.folder, ".vrt")
    assert {"ortho", "dsm", "terrain"} <= large
    assert large | rasters(sheeted.folder, ".tif") == rasters(run.folder, ".tif") and not large & rasters(sheeted.folder, ".tif")


def test_they_hold_the_pixels_of_the_single_files(run, sheeted):
    for name in rasters(sheeted.folder, ".vrt"):
        with (
            rasterio.open(sheeted.folder / f"products/{name}.vrt") as joined,
            rasterio.open(run.folder / f"products/{name}.tif") as one,
        ):
            assert joined.read().tobytes() == one.read().tobytes(), name
            assert (joined.crs, joined.transform, joined.descriptions) == (one.crs, one.transform, one.descriptions)


def test_every_link_of_the_report_opens_and_no_page_names_what_is_not_there(sheeted):
    page = (sheeted.folder / "report.html").read_text()
    links = {unquote(link) for link in re.findall(r'href="(products/[^"#]+)"', page)}
    assert "products/ortho.vrt" in links and "products/dsm.vrt" in links
    assert [link for link in links if not (sheeted.folder / link).exists()] == []
    assert {name for name in re.findall(r"products/[\w.-]+\.tif", page) if not (sheeted.folder / name).exists()} == set()


def test_every_command_finds_them(sheeted, monkeypatch):
    monkeypatch.chdir(sheeted.root)
    assert "0 jobs run" in command("run", PROJECT, "--sequential")
    assert "damaged" not in command("verify", PROJECT)
    for words in (("--as", "geotiff", "--of", "terrain"), ("--as", "jpeg"), ("--as", "hillshade"), ("--as", "glb")):
        assert Path(command("export", PROJECT, *words)).is_file()
    products = sheeted.folder / "products"
    with rasterio.open(products / "exported/terrain.tif") as one, rasterio.open(products / "terrain.vrt") as joined:
        assert one.read(1).tobytes() == joined.read(1).tobytes()
    assets = json.loads(Path(command("export", PROJECT, "--as", "stac")).read_text())["assets"]
    assert {"ortho.vrt", "ortho_sheets/0-0.tif"} <= set(assets) and assets["ortho.vrt"]["proj:shape"]
    few = command("accept", PROJECT, "--profile", "asprs_2023", "--plan", "5", "--height", "5", code=MISSED)
    assert "met accuracy in plan" in few and "met accuracy in height" in few
    files = json.loads((sheeted.folder / "acceptance.json").read_text())["record"]["files"]
    assert {"products/ortho.vrt", "products/ortho_sheets/0-0.tif"} <= {file["path"] for file in files}
