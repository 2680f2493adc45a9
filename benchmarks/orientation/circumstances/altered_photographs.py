"""Small copies of a public flight with one thing about them altered: tags, pixels, names, files beside them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from PIL import Image

SIZE = (400, 225)
"""px of the copies"""
GPS, EXIF, MAKER_NOTE, PADDING = 0x8825, 0x8769, 0x927C, 0xEA1C
ORIENTATION, SERIAL, ZOOM = 0x0112, 0xA431, 0xA404
SEA_LEVEL, ALTITUDE = 5, 6
_PACKET = (
    '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about=""'
    ' xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" xmlns:Camera="http://pix4d.com/camera/1.0/"'
    ' xmlns:GPano="http://ns.google.com/photos/1.0/panorama/"{}/>'
    '</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
)


@dataclass(frozen=True)
class Altered:
    """How copies differ from the photographs with these `numbers` in the order of the flight, each by its number: `zoom`: by which
    part of the frame the copy is enlarged; `tags`: changes the EXIF tags; `packet`: XMP tags by their names; `name`: of the copy,
    with folders; `suffix`; `with_gps`: whether its position is kept; `picture`: of its pixels; `data`: of the bytes of its file;
    `beside`: bytes of further files by name."""

    numbers: Sequence[int]
    zoom: Callable[[int], float] = lambda number: 1.0
    tags: Callable[[int, Image.Exif], None] = lambda number, tags: None
    packet: Callable[[int], dict[str, str]] = lambda number: {}
    name: Callable[[int], str] = lambda number: f"DJI_{number + 18:04d}"
    suffix: str = ".JPG"
    with_gps: bool = True
    picture: Callable[[Image.Image], Image.Image] = lambda image: image
    data: Callable[[int, bytes], bytes] = lambda number, data: data
    beside: Callable[["Flown"], dict[str, bytes]] = lambda flown: {}


@dataclass(frozen=True)
class Flown:
    """The photographs of the flight in `folder`, which are only read."""

    folder: Path

    def place(self, number: int) -> tuple[float, float, float]:
        """Latitude, longitude (degrees) and height (m) by the tags."""
        gps = _opened(self._file(number)).getexif().get_ifd(GPS)
        latitude, longitude = (sum(float(part) / 60.0**i for i, part in enumerate(gps[tag])) for tag in (2, 4))
        return latitude, -longitude, float(gps[ALTITUDE])

    def written(self, folder: Path, how: Altered) -> None:
        """The altered copies, in a new folder."""
        folder.mkdir(parents=True)
        for number in how.numbers:
            tags = self.tags(number)
            if not how.with_gps:
                del tags[GPS]
            how.tags(number, tags)
            file = folder / (how.name(number) + how.suffix)
            file.parent.mkdir(parents=True, exist_ok=True)
            packet = how.packet(number)
            more = {"xmp": packet_of(packet)} if packet else {}
            more |= {"quality": 93} if how.suffix == ".JPG" else {}
            image = how.picture(self.picture(number, how.zoom(number)))
            image.save(file, exif=tags if how.suffix == ".tif" else tags.tobytes(), **more)
            file.write_bytes(how.data(number, file.read_bytes()))
        for name, content in how.beside(self).items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)

    def tags(self, number: int) -> Image.Exif:
        """The tags of a photograph, without what belongs to the file of the original and padding as large as the copy itself."""
        tags = _opened(self._file(number)).getexif()
        for tag in (MAKER_NOTE, PADDING):
            tags.get_ifd(EXIF).pop(tag, None)
            tags.pop(tag, None)
        return tags

    def picture(self, number: int, zoom: float = 1.0) -> Image.Image:
        """The pixels of a photograph, enlarged by `zoom` and small."""
        return _small(self._file(number), zoom)

    def _file(self, number: int) -> Path:
        return sorted(self.folder.glob("*.JPG"))[number]


def packet_of(tags: dict[str, str]) -> bytes:
    """An XMP packet with these tags."""
    return _PACKET.format("".join(f' {name}="{value}"' for name, value in tags.items())).encode()


def _opened(file: Path) -> Image.Image:
    return Image.open(file)


@cache
def _small(file: Path, zoom: float) -> Image.Image:
    with Image.open(file) as image:
        width, height = image.size
        part = width / zoom, height / zoom
        box = ((width - part[0]) / 2, (height - part[1]) / 2, (width + part[0]) / 2, (height + part[1]) / 2)
        return image.resize(SIZE, Image.Resampling.LANCZOS, box=box)
