"""The map of a run: its tiles, its values, and that a browser opens it from the disk."""

import base64
import json
import re
import shutil
import subprocess
import zlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from orthomill.pipeline.export.exports import export
from orthomill.pipeline.export.viewer import layer_parts, point_cloud_script, tile_pyramid, value_tiles
from orthomill.pipeline.export.viewer.painted_tiles import painted, shades_of
from orthomill.pipeline.export.viewer.tile_pyramid import TilePyramid
from orthomill.pipeline.export.viewer.value_tiles import MILLIMETRES, NOTHING, SIZE, packed
from orthomill.schemas.bare_ground import ContourLines
from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.maps import map_parts as map_parts_schema
from orthomill.schemas.maps.map_page import MAP_PAGE, CloudLayer, MapCamera, MapPage, ValueLayer
from orthomill.schemas.maps.map_parts import CLOUD_FILE, EDGES_FILE, LINES_FILE, PAGE, MapLayer, Shades
from orthomill.schemas.raster import MapGrid, Window, map_raster
from orthomill.schemas.stage_report import Picture
from orthomill.tasks.viewer.plan import map_part_jobs
from orthomill.tasks.viewer.plan.map_part_jobs import map_parts
from orthomill.tasks.viewer.plan.viewer_jobs import last_files

ROWS, COLS = 300, 420
GRID = MapGrid(west=407000.0, north=4357300.0, cell=1.0, rows=ROWS, cols=COLS)
FINE = MapGrid(west=407000.0, north=4357300.0, cell=0.5, rows=2 * ROWS, cols=2 * COLS)
LINES = Table("terrain/contours.parquet", ContourLines)


def heights() -> np.ndarray:
    row, col = np.mgrid[:ROWS, :COLS]
    z = (100 + 0.05 * col + 3 * np.sin(row / 20)).astype(np.float32)
    z[:, :30] = np.nan
    return z


def colours() -> np.ndarray:
    row, col = np.mgrid[: 2 * ROWS, : 2 * COLS]
    rgb = np.stack([col % 256, row % 256, (row + col) % 256, np.full(row.shape, 255)], axis=-1).astype(np.uint8)
    rgb[:64] = 0
    return rgb


def store(folder: Path = Path()) -> SimpleNamespace:
    """A project's rasters and tables; the files of its exports are in `folder`."""
    codes = np.where(np.isfinite(heights()), 1 + (np.mgrid[:ROWS, :COLS][1] > 200), 0).astype(np.uint8)
    rasters = {"a/height": heights(), "a/sigma": np.full((ROWS, COLS), 0.1, np.float32), "a/code": codes, "a/ortho": colours()}
    specs = {
        name: map_raster(
            name, FINE if name == "a/ortho" else GRID, str(values.dtype), "EPSG:2100", 256, bands=4 if name == "a/ortho" else 0
        )
        for name, values in rasters.items()
    }
    tables = {MAP_PAGE.path: page(), LINES.path: contour()}
    return SimpleNamespace(
        spec=specs.__getitem__,
        read=lambda name, window: rasters[name][window.slices],
        table=lambda table: tables[table.path],
        tables=tables,
        file=lambda name: (folder / name).read_bytes(),
    )


def contour() -> ContourLines:
    flat, no = np.full(3, 101.0), np.zeros(3, bool)
    x, y, text = 407100 + np.arange(3.0), 4357100 + np.arange(3.0), np.array(["101"] * 3)
    return ContourLines(
        line=np.zeros(3, np.int64),
        x=x,
        y=y,
        z=flat,
        layer=np.array(["CONTOUR"] * 3),
        dashed=no,
        text=text,
        height=flat,
        index=~no,
        measured=~no,
        sigma=flat,
    )


def page() -> MapPage:
    classes = ((0, "#000000", "empty: no height"), (1, "#ff0000", "one"), (2, "#00ff00", "two"))
    pictures = (
        Picture(title="Orthoimage", raster="a/ortho", style="rgb"),
        Picture(title="Relief", raster="a/height", style="hillshade", unit="m"),
        Picture(title="Codes </script>", raster="a/code", style="classes", classes=classes),
        Picture(title="Ramp", raster="a/sigma", style="ramp", unit="m", low=0.0),
    )
    values = (ValueLayer(name="surface", title="Surface", rasters={"height": "a/height", "sigma": "a/sigma", "code": "a/code"}),)
    outline = ((407000.0, 4357000.0), (407400.0, 4357000.0), (407400.0, 4357300.0), (407000.0, 4357300.0))
    cameras = (MapCamera(name="a.jpg", centre=(407200.0, 4357150.0, 900.0), outline=outline),)
    cloud = CloudLayer(height="a/height", code="a/code", shown=(2,), colours="a/ortho")
    return MapPage(project="volos", pictures=pictures, values=values, cameras=cameras, system="EPSG:2100", cloud=cloud)


def parts(view: SimpleNamespace) -> list[Job | Export]:
    return list(map_parts(view, page().pictures, page().values, page().cloud, {LINES_FILE: (LINES,), EDGES_FILE: (LINES,)}))


def written(folder: Path) -> Path:
    """The products of the page and all its parts, made one after the other."""
    kept = store(folder)
    exports = []
    for part in parts(SimpleNamespace(raster=kept.spec)):
        if isinstance(part, Job):
            kept.tables[part.writes["told"].path] = part.function(**part.params)
        else:
            exports.append(part)
    exports.append(Export("viewer", "map", PAGE, "map", {}, (MAP_PAGE,), files=last_files(exports)))
    for one in exports:
        export(one, kept, folder)
    return folder / "products"


def made_tiles(layer: int, folder: Path, monkeypatch, side: int = 64) -> TilePyramid:
    """All tiles of a layer as one part."""
    monkeypatch.setattr(tile_pyramid, "TILE", side)
    monkeypatch.setattr(map_parts_schema, "TILE", side)
    picture, kept = page().pictures[layer], store()
    source = painted(kept, picture, shades_of(kept, picture))

    def finest(row: int, col: int) -> np.ndarray:
        out = np.zeros((side, side, 4), np.uint8)
        window = Window(row * side, col * side, side, side).clipped(source.spec.shape)
        out[: window.height, : window.width] = source.tile(kept, window)
        return out

    rows, cols = source.spec.shape[:2]
    pyramid = TilePyramid(MapLayer(number=layer, picture=picture, rows=rows, cols=cols), finest, folder)
    pyramid.write(0, 0)
    return pyramid


def test_tiles_of_the_finest_level_are_the_raster_and_the_coarsest_is_one(tmp_path, monkeypatch):
    pyramid = made_tiles(2, tmp_path, monkeypatch, side=128)
    assert len(pyramid.names) == 3 and len(pyramid.names[2]) == 1
    whole = np.zeros((ROWS, COLS, 4), np.uint8)
    for name in pyramid.names[0]:
        row, col = map(int, name.removesuffix(".webp").split("-"))
        tile = np.asarray(Image.open(tmp_path / "0" / name).convert("RGBA"))
        part = whole[row * 128 : (row + 1) * 128, col * 128 : (col + 1) * 128]
        part[:] = tile[: part.shape[0], : part.shape[1]]
    assert (whole[:, 30:201, :3] == (255, 0, 0)).all() and (whole[:, 201:, :3] == (0, 255, 0)).all()
    assert (whole[:, :30, 3] == 0).all() and (whole[:, 30:, 3] == 255).all()


def test_tiles_without_a_transparent_pixel_are_small_and_quick_ones(tmp_path, monkeypatch):
    pyramid = made_tiles(1, tmp_path, monkeypatch)
    kinds = {name: Path(name).suffix for name in pyramid.names[0]}
    for name, kind in kinds.items():
        tile = Image.open(tmp_path / "0" / name)
        assert (kind == ".jpg") == (tile.mode == "RGB" or np.asarray(tile.convert("RGBA"))[..., 3].min() == 255)
    assert set(kinds.values()) == {".jpg", ".webp"}


def test_relief_has_no_seams_at_tiles():
    source = painted(store(), page().pictures[1], shades_of(store(), page().pictures[1]))
    one = source.tile(store(), source.spec.full)
    parts = [source.tile(store(), type(source.spec.full)(0, col, ROWS, 105)) for col in range(0, COLS, 105)]
    assert np.array_equal(one, np.concatenate(parts, axis=1)) and one[..., :3].std() > 5


def test_codes_above_a_byte_have_their_colours():
    spec = map_raster("a", MapGrid(west=0.0, north=0.0, cell=1.0, rows=1, cols=4), "uint16", "EPSG:2100", 512)
    classes = ((0, "#ffffff", "no photograph"), (1, "#ff0000", "first"), (300, "#0000ff", "last"))
    picture = Picture(title="a", raster="a", style="classes", classes=classes)
    nothing, first, last, unknown = (
        painted(SimpleNamespace(spec=lambda _: spec), picture, Shades()).paint(np.array([[0, 1, 300, 301]], np.uint16))[0].tolist()
    )
    assert nothing[3] == 0 and first == [255, 0, 0, 255] and last == [0, 0, 255, 255] and unknown not in (nothing, first, last)


def test_values_are_packed_in_millimetres():
    z = heights()[:SIZE, :SIZE]
    steps = np.frombuffer(zlib.decompress(base64.b64decode(packed(z))), "<i4").reshape(z.shape)
    back = np.cumsum(steps.astype(np.int64), axis=1).astype(np.int32)
    known = np.isfinite(z)
    assert (back[~known] == NOTHING).all() and np.abs(back[known] / MILLIMETRES - z[known]).max() <= 0.00051


def test_points_in_space_are_the_cells_that_are_shown_in_their_colours(tmp_path, monkeypatch):
    monkeypatch.setattr(point_cloud_script, "MOST_POINTS", ROWS * COLS // 4)
    point_cloud_script.write_cloud(Export("viewer", "points", CLOUD_FILE, "map points", {}, (MAP_PAGE,)), store(), tmp_path / "c")
    about = json.loads((tmp_path / "c").read_text().removeprefix("omCloud(").removesuffix(");\n"))
    n, data = about["count"], zlib.decompress(base64.b64decode(about["data"]))
    col, row, steps = (np.frombuffer(data, "<u2", n, 2 * n * k).astype(int) for k in range(3))
    red = np.frombuffer(data, np.uint8, n, 6 * n).astype(int)
    assert about["cell"] == 2.0 and n == ROWS // 2 * len(range(202, COLS, 2)) and col.min() == 101
    z = about["low"] + (about["high"] - about["low"]) * steps / 65535
    assert np.abs(z - heights()[2 * row, 2 * col]).max() < 0.002
    bright = row >= 16
    assert (red[bright] == (4 * col + 1)[bright] % 256).all() and (red[~bright] == 170).all()


def test_the_page_is_small_loads_nothing_from_elsewhere_and_bears_any_title(tmp_path):
    products = written(tmp_path)
    text = (products / "index.html").read_text()
    assert len(text) < 2_000_000 and text.count("</script>") == 3
    assert not re.search(r"""(src=|<link[^>]*href=|url\()["']?https?:""", text) and "@import" not in text
    data = json.loads(re.search(r"const OM = (.*);</script>", text).group(1).replace("<\\/", "</"))
    assert [layer["title"] for layer in data["layers"]][2] == "Codes </script>"
    for layer in data["layers"]:
        for level, runs in layer["levels"].items():
            names = {f"{row}-{col}{kind}" for row, first, last, kind in runs for col in range(first, last + 1)}
            assert {path.name for path in (products / layer["folder"] / level).iterdir()} == names
    assert data["values"]["tiles"] == [[0, 0, 1], [1, 0, 1]]
    for name in ("lines", "edges"):
        assert (products / data[name]).read_text().startswith(f"omLines('{name}',")


def test_a_map_of_many_parts_differs_from_that_of_one_in_its_coarse_tiles_alone_and_hardly(tmp_path, monkeypatch):
    for name, side, levels in (("one", 64, 5), ("many", 64, 2)):
        small_tiles(monkeypatch, side, levels)
        written(tmp_path / name)
    one, many = (tmp_path / name / "products" / "viewer" for name in ("one", "many"))
    tiles = {path.relative_to(one) for path in one.rglob("*.*") if path.suffix in (".jpg", ".webp", ".js")}
    assert tiles == {path.relative_to(many) for path in many.rglob("*.*") if path.suffix in (".jpg", ".webp", ".js")}
    assert len(list(many.glob("0/parts/*-*.json"))) > len(list(one.glob("0/parts/*-*.json"))) == 1
    for path in tiles:
        if path.suffix == ".js" or path.parent.name in "01":
            assert (one / path).read_bytes() == (many / path).read_bytes(), path
        else:
            a, b = (np.asarray(Image.open(place / path).convert("RGBA"), float) for place in (one, many))
            assert np.abs(a - b).mean() < 4


def test_what_earlier_maps_left_is_removed(tmp_path):
    viewer = written(tmp_path) / "viewer"
    before = {path for path in viewer.rglob("*") if path.is_file()}
    for left in ("0/0/7-7.jpg", "0/9/0-0.jpg", "0/parts/0-9-9.json", "44/0/0-0.jpg", "values/9-9.js"):
        (viewer / left).parent.mkdir(parents=True, exist_ok=True)
        (viewer / left).write_bytes(b"old")
    written(tmp_path)
    assert {path for path in viewer.rglob("*") if path.is_file()} == before


def test_a_part_waits_for_what_lies_under_it_and_the_page_for_all(tmp_path, monkeypatch):
    small_tiles(monkeypatch, 64, 2)
    made = [part for part in parts(SimpleNamespace(raster=store().spec)) if isinstance(part, Export)]
    first = next(part for part in made if part.item == "layer1-tiles0" and (part.row, part.col) == (1, 1))
    assert first.window == Window(127, 127, 130, 130), "relief is shaded from the pixels around"
    coarse = next(part for part in made if part.item == "layer1-tiles2")
    below = {part.path for part in made if part.item == "layer1-tiles0"}
    assert coarse.window is None and set(coarse.files) == below
    reached, files = set(), {part.path: part.files for part in made}
    waiting = list(last_files(made))
    while waiting:
        reached.add(path := waiting.pop())
        waiting += files[path]
    assert reached == set(files)


def small_tiles(monkeypatch, side: int, levels: int) -> None:
    """Maps whose parts have so many levels of tiles of `side` px."""
    span = 1 << (levels - 1)
    changed = {"TILE": side, "SIZE": side, "LEVELS": levels, "SPAN": span, "PART": span * side, "FINER": 1 << levels}
    for module in (map_parts_schema, tile_pyramid, layer_parts, value_tiles, map_part_jobs):
        for name in changed.keys() & vars(module).keys():
            monkeypatch.setattr(module, name, changed[name])


@pytest.mark.slow
def test_a_browser_opens_it_from_the_disk_knows_the_height_of_a_place_and_draws_the_points(tmp_path):
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no browser here")
    index = written(tmp_path) / "index.html"
    asks = "om.valueAt('surface.height',407100.5,4357200.5).then((v)=>{document.title='height '+v});"
    asks += "document.getElementById('space').click();"
    index.write_text(index.read_text().replace("window.om = {", f"setTimeout(()=>{{{asks}}},200);window.om = {{"))
    flags = [
        "--headless=new",
        "--no-sandbox",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--virtual-time-budget=6000",
        f"--user-data-dir={tmp_path / 'profile'}",
    ]
    dom = subprocess.run([browser, *flags, "--dump-dom", index.as_uri()], capture_output=True, text=True, timeout=240).stdout
    z = heights()[99, 100]
    found = re.search(r"<title>height (\d+)</title>", dom)
    assert found and int(found.group(1)) == pytest.approx(z * 1000, abs=1)
    assert re.search(r'viewer/0/1/0-0\.(jpg|webp)"', dom) and dom.count('class="choice"') == 4
    assert "points, one every 1.00 m, measured heights only" in dom
