"""What a file beside photographs is, by its name: a photograph that can be read, or one of the kinds that are counted and left out.

HEIC and raw photographs are read where the libraries of the extra `formats` are installed (pi-heif with libheif, rawpy with
LibRaw).
"""

from enum import StrEnum
from functools import cache
from importlib.util import find_spec
from pathlib import Path, PurePath

DEVELOPED_SUFFIXES = frozenset({".jpg", ".jpeg", ".tif", ".tiff", ".png"})
HEIF_SUFFIXES = frozenset({".heic", ".heif"})
RAW_SUFFIXES = frozenset({".dng", ".arw", ".cr2", ".cr3", ".nef", ".nrw", ".orf", ".raf", ".rw2", ".pef", ".srw", ".iiq", ".3fr"})
PHOTOGRAPH_SUFFIXES = DEVELOPED_SUFFIXES | HEIF_SUFFIXES | RAW_SUFFIXES
LIST_SUFFIXES = frozenset(
    {".txt", ".csv", ".dat", ".gcp", ".pos", ".mrk", ".xml", ".tsv", ".gsi", ".json", ".yaml", ".yml", ".cam"}
)
"""of what may hold control, positions or a camera beside photographs"""
FOREIGN_SUFFIXES = frozenset({".xlsx", ".xls", ".ods", ".kml", ".kmz", ".gpx", ".geojson", ".shp", ".gpkg", ".dxf", ".dwg"})
"""of files that may hold control or positions, and are not read: people are told what they are"""
_VIDEO = frozenset({".mp4", ".mov", ".avi", ".mts", ".m2ts", ".mkv", ".insv", ".360"})
_PREVIEW = frozenset({".thm", ".lrf", ".lrv", ".scr"})
_IMAGE = frozenset(
    {".gif", ".bmp", ".webp", ".jp2", ".j2k", ".jxl", ".jxr", ".avif", ".psd", ".ecw", ".sid", ".exr", ".hdr", ".insp"}
)
_FOLDER_PICTURES = frozenset({"thumbs.db", "desktop.ini", ".ds_store"})
EXTRA = "install the extra for them: pip install 'orthomill[formats]'"
_LONGEST_LINK = 1024
"""bytes"""


class Kind(StrEnum):
    """What is found in a folder of photographs."""

    PHOTOGRAPH = "photograph"
    HEIF = "heif"
    RAW = "raw"
    RAW_BESIDE = "raw_beside"
    MASK = "mask"
    BELOW = "below"
    LINKED_FOLDER = "linked_folder"
    BROKEN_LINK = "broken_link"
    UNREADABLE = "unreadable"
    HIDDEN = "hidden"
    VIDEO = "video"
    PREVIEW = "preview"
    IMAGE = "image"
    OTHER = "other"
    """No photograph, nor taken for one: texts, tables, system files."""


SPEECH: dict[Kind, tuple[str, str, str]] = {
    Kind.HEIF: ("HEIC photograph", "HEIC photographs", EXTRA),
    Kind.RAW: ("raw photograph", "raw photographs", EXTRA),
    Kind.RAW_BESIDE: ("raw photograph", "raw photographs", "a developed one of the same name lies beside it and is used"),
    Kind.MASK: ("mask", "masks", "name their folder in the workflow (photographs > masks) to use them"),
    Kind.BELOW: ("photograph in folders below", "photographs in folders below", "set 'folders: all' in the workflow to take them"),
    Kind.LINKED_FOLDER: ("link to a folder", "links to folders", "they are not followed"),
    Kind.BROKEN_LINK: ("broken link", "broken links", "copy the photographs that were meant"),
    Kind.UNREADABLE: ("folder that cannot be read", "folders that cannot be read", "correct the permissions"),
    Kind.HIDDEN: ("hidden file named like a photograph", "hidden files named like photographs", "they hold no picture"),
    Kind.VIDEO: ("video", "videos", "only photographs are used"),
    Kind.PREVIEW: ("preview made by the camera", "previews made by the camera", "only photographs are used"),
    Kind.IMAGE: ("image of another format", "images of other formats", "save them as JPEG, TIFF or PNG to use them"),
}
"""For whatever is left out: what one and several are called, and why or what to do."""


@cache
def readable_suffixes() -> frozenset[str]:
    """Endings of the photographs that this installation reads, in small letters."""
    heif = HEIF_SUFFIXES if find_spec("pi_heif") else frozenset()
    raw = RAW_SUFFIXES if find_spec("rawpy") else frozenset()
    return DEVELOPED_SUFFIXES | heif | raw


def is_image_name(name: str) -> bool:
    """Whether a file is named like a photograph that can be read. Hidden files (`._DJI_0001.JPG` of macOS) are not."""
    return kind_of_file(name) is Kind.PHOTOGRAPH


def kind_of_file(name: str) -> Kind:
    """What a file is by its name."""
    path = PurePath(name)
    suffix = path.suffix.lower()
    if path.name.lower() in _FOLDER_PICTURES:
        return Kind.OTHER
    if suffix in DEVELOPED_SUFFIXES | HEIF_SUFFIXES | RAW_SUFFIXES and path.name.startswith("."):
        return Kind.HIDDEN
    if suffix in readable_suffixes():
        return Kind.PHOTOGRAPH
    kinds = (
        (Kind.HEIF, HEIF_SUFFIXES),
        (Kind.RAW, RAW_SUFFIXES),
        (Kind.VIDEO, _VIDEO),
        (Kind.PREVIEW, _PREVIEW),
        (Kind.IMAGE, _IMAGE),
    )
    return next((kind for kind, suffixes in kinds if suffix in suffixes), Kind.OTHER)


def is_link_text(path: Path) -> bool:
    """Whether a file is a text that stands for a photograph: the target of a link, as git and zip write it where links are not
    possible, or a pointer of Git LFS or git-annex."""
    try:
        if path.stat().st_size > _LONGEST_LINK:
            return False
        text = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError):  # what cannot be read is told when the photograph is
        return False
    if text.startswith("version https://git-lfs.github.com/"):
        return True
    target = text.strip()
    return target.isprintable() and "/" in target and PurePath(target).suffix.lower() == path.suffix.lower()
