"""XML without entities, which can grow without bound or read other files; no file of points has any."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat


class _NoEntitiesError(Exception):
    """XML that no program writes for points."""


def parsed(text: str, what: str, mistakes: list[str]) -> Element | None:
    """The root of a text; None, and a mistake, where it cannot be read."""
    builder = TreeBuilder()
    # The text is Unicode already, whatever its first line says of its bytes.
    parser = expat.ParserCreate("UTF-8")
    parser.EntityDeclHandler = _refuse
    parser.StartElementHandler = lambda name, own: builder.start(name, own) and None
    parser.EndElementHandler = lambda name: builder.end(name) and None
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text.strip().encode(), True)
        return builder.close()
    except (expat.ExpatError, _NoEntitiesError) as error:
        mistakes.append(f"The control file ({what}) is no XML that can be read ({error}); export it anew.")
        return None


def _refuse(*_: object) -> None:
    raise _NoEntitiesError("it defines entities")


def named(tree: Element, name: str) -> Iterator[Element]:
    """All elements of a name, with any prefix."""
    return (node for node in tree.iter() if node.tag.rpartition(":")[2] == name)


def text_of(node: Element, name: str) -> str:
    """The text of the first element of a name below another; "" without it."""
    return next(((found.text or "").strip() for found in named(node, name)), "")
