"""Points of LandXML: `<CgPoint name="P1">northing easting height</CgPoint>`, as Trimble, Leica and CAD programs export them.

Source: LandXML 1.2 schema, CgPoint: "the coordinate text values are northing easting elevation, delimited by a space".
"""

from orthomill.tasks.orientation.control.control_rows import Row, Rows, StatedControl, stated_row
from orthomill.tasks.orientation.control.formats.plain_xml import named, parsed

_UNITS = {"foot": 0.3048, "ussurveyfoot": 1200.0 / 3937.0, "millimeter": 0.001, "centimeter": 0.01, "meter": 1.0, "": 1.0}


def is_landxml(text: str) -> bool:
    """Whether a text is LandXML."""
    return text.lstrip().startswith("<") and "<LandXML" in text[:4000]


def landxml_rows(text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The points of the file; what is wrong is added to `mistakes`."""
    tree = parsed(text, "LandXML", mistakes)
    if tree is None:
        return Rows("LandXML", ())
    units = next((node.get("linearUnit", "") for word in ("Metric", "Imperial") for node in named(tree, word)), "")
    unit = _UNITS.get(units.lower())
    if unit is None:
        mistakes.append(f"The control points file (LandXML) is in the unit '{units}', which is not known; export it in metres.")
        return Rows("LandXML", ())
    rows: list[Row] = []
    for number, node in enumerate(named(tree, "CgPoint"), 1):
        name, words = node.get("name", "").strip(), (node.text or "").split()
        # A point may stand for another one (pntRef), and then has no coordinates.
        if not words:
            continue
        try:
            y, x, *rest = (float(word) * unit for word in words)
        except ValueError:
            mistakes.append(f"Control points file, point {name}: '{' '.join(words)[:60]}' must hold northing, easting and height.")
            continue
        rows.append((number, stated_row(name, {"x": repr(x), "y": repr(y), "z": repr(rest[0]) if rest else "nan"}, stated)))
    if not rows and not mistakes:
        mistakes.append("The control points file (LandXML) holds no points (CgPoint); export the points with it.")
    code = next((node.get("epsgCode", "") for node in named(tree, "CoordinateSystem")), "")
    return Rows("LandXML", tuple(rows), f"EPSG:{code}" if code.isdigit() else None)
