"""XML of ISO's metadata as nested calls: an element by its prefixed name, with text or children."""

from xml.etree import ElementTree

ISO = "http://standards.iso.org/iso/19115/-3/"
SPACES = {
    "mdb": f"{ISO}mdb/2.0",
    "cit": f"{ISO}cit/2.0",
    "gex": f"{ISO}gex/1.0",
    "lan": f"{ISO}lan/1.0",
    "mcc": f"{ISO}mcc/1.0",
    "mri": f"{ISO}mri/1.0",
    "mrd": f"{ISO}mrd/1.0",
    "mrl": f"{ISO}mrl/2.0",
    "mrs": f"{ISO}mrs/1.0",
    "gco": f"{ISO}gco/1.0",
    "mdq": "http://standards.iso.org/iso/19157/-2/mdq/1.0",
    "gml": "http://www.opengis.net/gml/3.2",
}
_CODES = "http://standards.iso.org/iso/19115/resources/Codelists/cat/codelists.xml"
Element = ElementTree.Element


def element(name: str, *children: Element | str, **attributes: str) -> Element:
    """An element such as "mdq:scope"; a child that is a text becomes its text."""
    made = Element(_full(name), {_full(key.replace("_", ":")) if "_" in key else key: value for key, value in attributes.items()})
    for child in children:
        if isinstance(child, str):
            made.text = child
        else:
            made.append(child)
    return made


def words(name: str, text: str) -> Element:
    """An element with a text."""
    return element(name, element("gco:CharacterString", text))


def code(name: str, kind: str, value: str) -> Element:
    """An element with a value of a code list, e.g. mdq:evaluationMethodType, mdq:DQ_EvaluationMethodTypeCode."""
    return element(name, element(kind, value, codeList=f"{_CODES}#{kind.partition(':')[2]}", codeListValue=value))


def document(root: Element) -> str:
    """The text of a file."""
    for prefix, space in SPACES.items():
        ElementTree.register_namespace(prefix, space)
    ElementTree.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _full(name: str) -> str:
    prefix, _, own = name.partition(":")
    return f"{{{SPACES[prefix]}}}{own}" if own else name
