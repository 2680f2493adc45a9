"""Markers that Metashape exported as XML: their coordinates, and their projections in the photographs.

`<cameras>` name photographs by number, `<markers>` hold a label and a `<reference x y z sx sy sz enabled>`, and `<frames>` the
projections: `<location camera_id x y pinned>`. Those that are not pinned were predicted by the program, and are no measurements.
Source: files of Metashape 1.5 to 2.1; Agisoft's manual, "Export markers".
"""

from typing import Any
from xml.parsers import expat

from orthomill.tasks.orientation.control.control_rows import Row, Rows, StatedControl

_DEEPEST = 64


def is_markers_xml(text: str) -> bool:
    """Whether a text is XML with markers."""
    return text.lstrip().startswith("<") and "<markers" in text[:50_000_000]


class Markers:
    """What the elements of the file say, gathered while they are read."""

    def __init__(self) -> None:
        self.photos: dict[str, str] = {}
        self.labels: dict[str, str] = {}
        self.reference: dict[str, dict[str, str]] = {}
        self.marks: list[tuple[int, str, str, dict[str, str]]] = []
        self.crs = ""
        self._open: list[tuple[str, dict[str, str]]] = []
        self._reading_crs = False

    def read(self, text: str) -> str | None:
        """Read the text; what is wrong with it, as a sentence."""
        # The text is Unicode already, whatever its first line says of its bytes.
        parser = expat.ParserCreate("UTF-8")
        # Entities can grow without bound or read other files; no marker file has any.
        parser.EntityDeclHandler = _refuse
        parser.StartElementHandler = lambda name, own: self._start(parser, name, own)
        parser.EndElementHandler = lambda name: self._end()
        parser.CharacterDataHandler = self._text
        try:
            parser.Parse(text.encode(), True)
        except (expat.ExpatError, _EntityError, RecursionError) as error:
            return f"The markers file is no XML that can be read ({error}); export it anew."
        return None

    def _start(self, parser: Any, name: str, own: dict[str, str]) -> None:
        if len(self._open) > _DEEPEST:
            raise _EntityError("too many levels")
        within = [tag for tag, _ in self._open]
        parent = self._open[-1][1] if self._open else {}
        if name == "camera" and "label" in own:
            self.photos[own.get("id", "")] = own["label"]
        elif name == "marker" and "label" in own and "frames" not in within:
            self.labels[own.get("id", "")] = own["label"]
        elif name == "reference" and within and within[-1] == "marker" and "x" in own:
            self.reference[parent.get("id", parent.get("marker_id", ""))] = own
        elif name == "location" and "x" in own:
            marker = parent.get("marker_id", parent.get("id", ""))
            self.marks.append((parser.CurrentLineNumber, marker, own.get("camera_id", ""), own))
        # The markers' own system, where it differs from that of the photographs, comes last.
        self._reading_crs = name == "reference" and "chunk" in within[-1:]
        if self._reading_crs:
            self.crs = ""
        self._open.append((name, own))

    def _end(self) -> None:
        self._open.pop()
        self._reading_crs = False

    def _text(self, text: str) -> None:
        if self._reading_crs:
            self.crs += text


class _EntityError(Exception):
    """XML that no program writes for markers."""


def _refuse(*_: object) -> None:
    raise _EntityError("it defines entities")


def marker_rows(text: str, stated: StatedControl, mistakes: list[str]) -> tuple[Rows, Rows]:
    """Points and measurements of the markers; what is wrong is added to `mistakes`."""
    found = Markers()
    if mistake := found.read(text):
        mistakes.append(mistake)
    points: list[Row] = []
    for number, (marker, name) in enumerate(found.labels.items(), 1):
        own = found.reference.get(marker)
        if own:
            points.append((number, _point(name, own, stated)))
    named = {row["name"] for _, row in points}
    marks = []
    for line, marker, camera, own in found.marks:
        name = found.labels.get(marker, "")
        if name in named and own.get("pinned", "1").lower() not in ("0", "false"):
            photo = found.photos.get(camera, f"camera {camera}")
            marks.append(
                (line, {"name": name, "photo": photo, "col": own["x"], "row": own.get("y", ""), "sigma": repr(stated.sigma_px)})
            )
    form, crs = "Metashape markers (XML)", found.crs.strip() or None
    skipped = len(found.labels) - len(points)
    return Rows(form, tuple(points), crs, skipped), Rows(form, tuple(marks), corner=True)


def _point(name: str, own: dict[str, str], stated: StatedControl) -> dict[str, str]:
    plan, height = repr(stated.sigma_plan), repr(stated.sigma_height)
    return {
        "name": name,
        # Metashape adjusts with enabled markers, and takes the others as check points.
        "role": "check" if name in stated.check or own.get("enabled", "1").lower() in ("0", "false") else "control",
        "x": own["x"],
        "y": own.get("y", ""),
        "z": own.get("z", "nan"),
        "sigma_x": own.get("sx", plan),
        "sigma_y": own.get("sy", own.get("sx", plan)),
        "sigma_z": own.get("sz", height),
    }
