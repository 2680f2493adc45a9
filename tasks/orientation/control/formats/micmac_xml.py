"""Points and measurements of MicMac: DicoAppuisFlottant (-S3D.xml) and SetOfMesureAppuisFlottants (-S2D.xml).

`<OneAppuisDAF><Pt>x y z</Pt><NamePt>..</NamePt><Incertitude>..`, `<MesureAppuiFlottant1Im><NameIm>..</NameIm><OneMesureAF1I>
<NamePt>..</NamePt><PtIm>col row</PtIm>`. Source: MicMac's ParamChantierPhotogram.xml and its documentation, GCPConvert.
"""

from orthomill.tasks.orientation.control.control_rows import Row, Rows, StatedControl, stated_row
from orthomill.tasks.orientation.control.formats.plain_xml import named, parsed, text_of

_PLACEHOLDERS = ({"1"}, {"10"})
"""uncertainties that MicMac's tools write where nobody states any"""


def is_micmac(text: str) -> bool:
    """Whether a text holds points or measurements of MicMac."""
    return text.lstrip().startswith("<") and ("AppuisFlottant" in text[:4000] or "AppuiFlottant" in text[:4000])


def micmac_points(text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The points of the file; what is wrong is added to `mistakes`."""
    rows: list[Row] = []
    tree = parsed(text, "MicMac", mistakes)
    for number, node in enumerate(named(tree, "OneAppuisDAF") if tree is not None else (), 1):
        name, place, errors = text_of(node, "NamePt"), text_of(node, "Pt").split(), text_of(node, "Incertitude").split()
        if len(place) != 3 or not name:
            mistakes.append(f"Control points file (MicMac), point {number} '{name}': it must hold a name and three coordinates.")
            continue
        own = dict(zip(("x", "y", "z"), place, strict=True))
        if len(errors) == 3 and set(errors) not in _PLACEHOLDERS:
            own |= dict(zip(("sigma_x", "sigma_y", "sigma_z"), errors, strict=True))
        rows.append((number, stated_row(name, own, stated)))
    if not rows and not mistakes:
        mistakes.append("The control points file (MicMac) holds no points; give the one with coordinates (DicoAppuisFlottant).")
    return Rows("MicMac points", tuple(rows))


def micmac_marks(text: str, stated: StatedControl, mistakes: list[str]) -> Rows:
    """The measurements of the file."""
    rows: list[Row] = []
    tree = parsed(text, "MicMac", mistakes)
    number = 0
    for image in named(tree, "MesureAppuiFlottant1Im") if tree is not None else ():
        for mark in named(image, "OneMesureAF1I"):
            number += 1
            own = {"name": text_of(mark, "NamePt"), "photo": text_of(image, "NameIm"), "sigma": repr(stated.sigma_px)}
            col, row, *_ = [*text_of(mark, "PtIm").split(), "", ""]
            rows.append((number, own | {"col": col, "row": row}))
    if not rows and not mistakes:
        mistakes.append("The control measurements file (MicMac) holds none; give the one with SetOfMesureAppuisFlottants.")
    return Rows("MicMac measurements", tuple(rows))
