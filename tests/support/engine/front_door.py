"""A small catalogue of stages and a small project on disk, for the tests of the workflow file."""

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from PIL import Image
from pydantic import Field

from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import Stage


class Ellipse(Settings):
    """A window stretched along the direction of low texture."""

    kind: Literal["ellipse"]
    max_axis_ratio: float = setting(4.0, "Longest over shortest axis.", gt=1, le=8)


class Square(Settings):
    """A plain window."""

    kind: Literal["square"]


class MatchingStage(Stage):
    """Finds homologous points."""

    title: ClassVar[str] = "matches points"

    kind: Literal["matching"] = "matching"
    size: int = setting(21, "Side of the window.", "px", ge=3, le=255)
    cell: float = setting(0.5, "Side of a cell.", "m", gt=0)
    centre: Literal["mean", "median"] = setting("mean", "Which middle counts.")
    window: Annotated[Ellipse | Square, Field(discriminator="kind")] = setting(Square(kind="square"), "Shape of the window.")
    levels: tuple[float, ...] = setting((1e-5, 2.0), "Thresholds | one for each level.")
    limit: float | None = setting(None, "Largest difference.", "m")
    back: bool = setting(True, "Match back as well.")


class PaintingStage(Stage):
    """Paints the surface."""

    title: ClassVar[str] = "paints"

    kind: Literal["painting"] = "painting"
    colours_path: ProjectPath | None = setting(None, "File with colours.")
    note: str = setting("", "Whatever is to be said.")


CATALOGUE: tuple[type[Stage], ...] = (MatchingStage, PaintingStage)


def photograph(path: Path, make: str = "", width: int = 64, gps: tuple[float, float] | None = None, focal: float = 0.0) -> Path:
    """Write a small JPEG with the EXIF tags that are asked for."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(len(path.name)).integers(0, 255, (48, width, 3), dtype=np.uint8)
    image = Image.fromarray(pixels)
    exif = image.getexif()
    if make:
        exif[0x010F], exif[0x0110] = make.split(" ", 1)
    if focal:
        exif.get_ifd(0x8769)[0x920A] = focal
    if gps:
        exif.get_ifd(0x8825).update({1: "NS"[gps[1] < 0], 2: _degrees(gps[1]), 3: "EW"[gps[0] < 0], 4: _degrees(gps[0])})
    image.save(path, quality=95, exif=exif)
    return path


def _degrees(value: float) -> tuple[float, float, float]:
    size = abs(value)
    minutes = (size % 1) * 60
    return float(int(size)), float(int(minutes)), (minutes % 1) * 60


def project(root: Path) -> Path:
    """A project with two photographs and control files; returns its root."""
    photograph(root / "photos" / "IMG_0001.JPG")
    photograph(root / "photos" / "IMG_0002.JPG")
    (root / "control").mkdir()
    (root / "control" / "points.csv").write_text("name,role,x,y,z,sigma_x,sigma_y,sigma_z\n")
    (root / "workflows").mkdir()
    return root


HEAD = "project: site\ncrs: EPSG:2100\nphotographs: {kind: folder, path: photos}\n"


def workflow(root: Path, text: str, name: str = "site.yaml") -> Path:
    """Write a workflow file of the project."""
    path = root / "workflows" / name
    path.write_text(text, encoding="utf-8")
    return path
