"""XMP packets to tags by name, as text: "drone-dji:RtkFlag" -> "50".

Makers write a value as an attribute, as an element or as a list of elements, under any prefix they like: the namespace decides. An
entity would be the beginning of every attack on a reader of XML, and XMP has none: a packet that declares one is not read.

Source: ISO 16684-1 (XMP), section 7.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from xml.parsers import expat

PREFIXES: dict[str, str] = {
    "ns.adobe.com/tiff/1.0": "tiff",
    "ns.adobe.com/exif/1.0": "exif",
    "cipa.jp/exif/1.0": "exifEX",
    "ns.adobe.com/exif/1.0/aux": "aux",
    "ns.adobe.com/xap/1.0": "xmp",
    "ns.google.com/photos/1.0/panorama": "GPano",
    "pix4d.com/camera/1.0": "Camera",
    "pix4d.com/drone/1.0": "drone",
    "dji.com/drone-dji/1.0": "drone-dji",
    "parrot.com/drone-parrot/1.0": "drone-parrot",
    "ns.parrot.com/drone-parrot/1.0": "drone-parrot",
    "sensefly.com/camera/1.0": "sensefly",
    "ns.sensefly.com/camera/1.0": "sensefly",
    "autelrobotics.com/drone-autel/1.0": "drone-autel",
    "skydio.com/drone-skydio/1.0": "drone-skydio",
    "yuneec.com/drone-yuneec/1.0": "drone-yuneec",
    "micasense.com/micasense/1.0": "MicaSense",
    "micasense.com/dls/1.0": "DLS",
    "ns.flir.com/xmp/1.0": "FLIR",
}
"""Namespaces, without scheme, www and slash at the end, in small letters -> the prefix under which their tags are known."""
_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_PACKET_LIMIT, _VALUE_LIMIT, _TAG_LIMIT, _DEPTH_LIMIT = 2**21, 2000, 500, 32
"""Characters of a packet and of a value, number of tags, elements in each other; more is not read: previews in base64, histories"""


class _Refused(Exception):
    """The packet declares an entity, or is built to be large."""


def xmp_tags(domain: Mapping[str, str]) -> dict[str, str]:
    """Tags by prefix and name from GDAL's domain xml:XMP; the values of a list are separated by commas, the names of structures by
    slashes. What stands before a damaged place is read, nothing of a packet that declares entities."""
    packet = _packet(domain)
    if not 0 < len(packet) <= _PACKET_LIMIT:
        return {}
    reader = _Reader()
    try:
        reader.parser.Parse(packet, True)
    except expat.ExpatError:
        pass
    except _Refused:
        return {}
    return {name: ",".join(values)[:_VALUE_LIMIT] for name, values in reader.found.items()}


def _packet(domain: Mapping[str, str]) -> str:
    # The library divides the packet at its first equals sign, as if it were NAME=VALUE, where GDAL gives it without a name.
    for key, value in domain.items():
        text = value if key == "xml:XMP" else f"{key}={value}"
        # A packet is padded, with blanks by the book and with zeros by some cameras.
        return text[max(text.find("<"), 0) : text.rfind(">") + 1]
    return ""


class _Reader:
    """What expat has found so far: the values of each tag."""

    def __init__(self) -> None:
        self.found: defaultdict[str, list[str]] = defaultdict(list)
        self._own: dict[str, str] = {}
        self._path: list[str] = []
        self._depth = 0
        self._text: list[str] = []
        self.parser = expat.ParserCreate(namespace_separator="\n")
        self.parser.buffer_text = True
        self.parser.StartDoctypeDeclHandler = self._refuse
        self.parser.EntityDeclHandler = self._refuse
        self.parser.StartNamespaceDeclHandler = self._namespace
        self.parser.StartElementHandler = self._start
        self.parser.CharacterDataHandler = self._text.append
        self.parser.EndElementHandler = self._end

    def _refuse(self, *_: object) -> None:
        raise _Refused

    def _namespace(self, prefix: str | None, address: str) -> None:
        self._own[address] = prefix or ""

    def _start(self, element: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > _DEPTH_LIMIT:
            raise _Refused
        self._text.clear()
        name = self._name(element)
        self._path += [name] if name else []
        for attribute, value in attributes.items():
            if own := self._name(attribute):
                self._keep("/".join((*self._path, own)), value)

    def _end(self, element: str) -> None:
        self._depth -= 1
        if self._path and (text := "".join(self._text).strip()):
            self._keep("/".join(self._path), text)
        self._text.clear()
        if self._name(element):
            self._path.pop()

    def _keep(self, name: str, value: str) -> None:
        if len(value) <= _VALUE_LIMIT and (name in self.found or len(self.found) < _TAG_LIMIT):
            self.found[name].append(value.strip())

    def _name(self, word: str) -> str:
        """Prefix and name; empty for the frame of the packet: RDF, XML and what has no namespace."""
        address, _, name = word.rpartition("\n")
        if not address or address in (_RDF, "adobe:ns:meta/", "http://www.w3.org/XML/1998/namespace"):
            return ""
        prefix = PREFIXES.get(re.sub(r"^https?://(www\.)?", "", address.lower()).rstrip("/"))
        own = self._own.get(address, "")
        # A prefix of the table that a stranger uses for something else must not pass for the maker's.
        return f"{prefix or (own if own not in PREFIXES.values() else f'other-{own}')}:{name}"
