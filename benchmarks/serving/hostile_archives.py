"""Archives that no honest client sends, of every kind that is known to harm whoever unpacks them."""

import io
import random
import stat
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator

OUTSIDE = "orthomill_hostile"
"""name of the files that paths out of an archive would make"""
_PATHS = [
    f"../{OUTSIDE}.jpg",
    f"../../../../../../tmp/{OUTSIDE}.jpg",
    f"/tmp/{OUTSIDE}.jpg",
    f"a/../../{OUTSIDE}.jpg",
    f"C:\\{OUTSIDE}.jpg",
    f"..\\..\\{OUTSIDE}.jpg",
    f"\\\\host\\share\\{OUTSIDE}.jpg",
    "../task.json",
    "../wishes.json",
]
_NAMES = [
    "a\x1b[2J.jpg",
    "a\n.jpg",
    "\u202egpj.a",
    "<script>alert(1)</script>.jpg",
    "x" * 60_000 + ".jpg",
    "con.jpg",
    ".hidden.jpg",
    "a.jpg:stream",
    "'; rm -rf $HOME; '.jpg",
    "%2e%2e%2fa.jpg",
    "task.json",
    ".lock",
]
_FILES = [("a.jpg", b"\xff\xd8" + b"a" * 400), ("b.jpg", b"\xff\xd8" + b"b" * 400)]
_LINK, _DEVICE, _PIPE = stat.S_IFLNK | 0o777, stat.S_IFBLK | 0o600, stat.S_IFIFO | 0o600
_MIB = 2**20


def hostile_archives(seed: int, count: int) -> Iterator[tuple[str, bytes]]:
    """So many archives in turns of all kinds: the kind, and the bytes."""
    chance, kinds = random.Random(seed), list(_KINDS)
    for number in range(count):
        kind = kinds[number % len(kinds)]
        yield kind, _KINDS[kind](chance)


def _packed(files: list[tuple[str, bytes]], mode: int = 0, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of names that are there twice
        with zipfile.ZipFile(stream, "w", method) as archive:
            for name, content in files:
                entry = zipfile.ZipInfo(name)
                entry.external_attr, entry.compress_type = mode << 16, method
                archive.writestr(entry, content)
    return stream.getvalue()


def _patched(content: bytes, at: int, form: str, *values: int) -> bytes:
    patched = bytearray(content)
    struct.pack_into(form, patched, at, *values)
    return bytes(patched)


def _headers(content: bytes) -> tuple[int, int]:
    """Where the last entry stands in the directory, and the end of the directory."""
    return content.rfind(b"PK\x01\x02"), content.rfind(b"PK\x05\x06")


def _lying_sizes(chance: random.Random) -> bytes:
    content = _packed(_FILES)
    entry, end = _headers(content)
    at, form = chance.choice([(entry + 20, "<I"), (entry + 24, "<I"), (entry + 42, "<I"), (end + 10, "<H"), (end + 12, "<I")])
    return _patched(content, at, form, chance.choice([0, 1, 0xFFF0, 0xFFFF]) * (65_537 if form == "<I" else 1))


def _flagged(chance: random.Random) -> bytes:
    """A password, or a packing that is not known."""
    content = _packed(_FILES)
    entry, _ = _headers(content)
    return _patched(content, *chance.choice([(entry + 8, "<H", 1), (entry + 10, "<H", 99), (entry + 10, "<H", 14)]))


def _overlapping(chance: random.Random) -> bytes:
    """Many entries of one and the same compressed block."""
    stored = _packed([("a.tif", bytes(8 * _MIB))])
    start, end = _headers(stored)
    entry, count = stored[start:end], chance.randrange(50, 200)
    names = [entry[:28] + struct.pack("<H", 9) + entry[30:46] + f"{number:05d}.tif".encode() for number in range(count)]
    directory = b"".join(names)
    tail = struct.pack("<4s4H2IH", b"PK\x05\x06", 0, 0, count, count, len(directory), start, 0)
    return stored[:start] + directory + tail


def _damaged(chance: random.Random) -> bytes:
    content = bytearray(_packed(_FILES))
    for _ in range(chance.randrange(1, 12)):
        content[chance.randrange(len(content))] = chance.randrange(256)
    return bytes(content[: chance.choice([len(content), chance.randrange(len(content))])])


def _huge_picture(chance: random.Random) -> bytes:
    """Pictures whose headers announce more than any memory holds."""
    size = chance.choice([60_000, 2**31 - 1])
    header = struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + header + struct.pack(">I", zlib.crc32(b"IHDR" + header))
    png += struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT"))
    return _packed([("a.png", png), ("b.png", png)])


def _markup(chance: random.Random) -> bytes:
    text = b"<svg xmlns='http://www.w3.org/2000/svg' onload='alert(1)'/>" * chance.randrange(1, 50)
    return _packed([("a.jpg", text), ("b.jpg", text), ("geo.txt", b"EPSG:4326\n" + b"a.jpg nan inf 1e999\n" * 50)])


def _odd_names(chance: random.Random) -> bytes:
    return _packed([*_FILES, (chance.choice(_NAMES), b"x")])


_KINDS: dict[str, Callable[[random.Random], bytes]] = {
    "paths that lead out": lambda chance: _packed([*_FILES, (chance.choice(_PATHS), b"x")]),
    "links": lambda chance: _packed([("a.jpg", chance.choice([b"/etc/passwd", b"../../../token.txt", b"a.jpg"]))], _LINK),
    "files below a link": lambda chance: _packed([("a", b"/tmp")], _LINK)[:-22] + _packed([(f"a/{OUTSIDE}.jpg", b"x")]),
    "devices and pipes": lambda chance: _packed(_FILES, chance.choice([_DEVICE, _PIPE])),
    "bombs": lambda chance: _packed([(f"{number}.tif", bytes(8 * _MIB)) for number in range(chance.randrange(8, 24))]),
    "one block many times": _overlapping,
    "archives in archives": lambda chance: _packed([*_FILES, ("inner.zip", _packed(_FILES)), ("c.jpg", _packed(_FILES))]),
    "sizes and counts that lie": _lying_sizes,
    "passwords and packings": _flagged,
    "packings that take memory": lambda chance: _packed(_FILES, 0, chance.choice([zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])),
    "damaged": _damaged,
    "no archives": lambda chance: chance.choice([b"", b"PK", b"PK\x05\x06" + bytes(18), chance.randbytes(3000)]),
    "odd names": _odd_names,
    "the same name twice": lambda chance: _packed([*_FILES, (chance.choice(["a.jpg", "A.JPG", "x/../a.jpg"]), b"x")]),
    "files that are folders": lambda chance: _packed([*_FILES, ("a.jpg/b.jpg", b"x"), ("gcp_list.txt/", b"")]),
    "many names": lambda chance: _packed([(f"{number}.jpg", b"") for number in range(chance.randrange(5000, 20_000))]),
    "pictures without end": _huge_picture,
    "markup as pictures": _markup,
}
