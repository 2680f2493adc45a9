"""Features as a drawing (DXF): layers, line types, heights and labels, for CAD.

Lines are polylines in space, so that CAD has their heights; a dashed line has the line type of its layer. Labels stand in the
middle of their line, along it, readable from the south.

Source: Autodesk, DXF Reference (R12 entities, which every CAD reads).
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from orthomill.pipeline.export.vectors.map_features import Feature, Layer

_CONTINUOUS, _DASHED = "CONTINUOUS", "DASHED"
_COLOURS = {False: 8, True: 30}
"""number of the colour of a layer: grey, orange for index lines"""
_TEXT_HEIGHT = 0.004
"""share of the width of the drawing"""
_PLACE = " 10\n%.4f\n 20\n%.4f\n 30\n%.4f\n"
"""a place, m: codes and values"""


def write_drawing(path: Path, layers: tuple[Layer, ...]) -> None:
    """The lines, outlines and points as a file at `path`."""
    with path.open("w", encoding="ascii", errors="replace", newline="\r\n") as target:
        target.writelines(_blocks(layers))


def _blocks(layers: tuple[Layer, ...]) -> Iterator[str]:
    """The file in pieces, none longer than a line of the map, of which one is in memory at a time."""
    low, high, used = _looked_through(feature for layer in layers for feature in layer.features)
    yield _text_of(_header(low, high))
    yield _text_of(_tables(used, float(np.abs(high[:2] - low[:2]).max())))
    size = max(_TEXT_HEIGHT * float((high[:2] - low[:2]).max()), 0.01)
    yield _text_of([(0, "SECTION"), (2, "ENTITIES")])
    for layer in layers:
        for feature in layer.features:
            yield _text_of(_point(feature)) if layer.kind == "point" else _polyline(feature, layer.kind == "area")
            if feature.text:
                yield _text_of(_label(feature, size))
    yield _text_of([(0, "ENDSEC"), (0, "EOF")])


def _looked_through(features: Iterable[Feature]) -> tuple[np.ndarray, np.ndarray, set[tuple[str, bool]]]:
    """What the head of the file says of the features: the least and the greatest X, Y, Z, and the layers with their line types."""
    low, high, used = np.full(3, np.inf), np.full(3, -np.inf), set[tuple[str, bool]]()
    for feature in features:
        low, high = np.minimum(low, feature.places.min(axis=0)), np.maximum(high, feature.places.max(axis=0))
        used |= {(feature.layer, feature.dashed), *([(_text_layer(feature), False)] if feature.text else ())}
    return (low, high, used) if used else (np.zeros(3), np.zeros(3), used)


def _text_of(pairs: Iterable[tuple[int, str]]) -> str:
    """Codes and values as lines."""
    return "".join(f"{code:>3}\n{value}\n" for code, value in pairs)


def _header(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[int, str]]:
    yield from ((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009"), (9, "$LTSCALE"), (40, "1.0"))
    for name, corner in (("$EXTMIN", low), ("$EXTMAX", high)):
        yield (9, name)
        yield from _place(corner)
    yield (0, "ENDSEC")


def _tables(used: set[tuple[str, bool]], width: float) -> Iterator[tuple[int, str]]:
    yield from ((0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LTYPE"), (70, "2"))
    yield from ((0, "LTYPE"), (2, _CONTINUOUS), (70, "0"), (3, "Solid line"), (72, "65"), (73, "0"), (40, "0.0"))
    dash = max(width / 250, 0.1)
    yield from ((0, "LTYPE"), (2, _DASHED), (70, "0"), (3, "__ __ __"), (72, "65"), (73, "2"), (40, f"{1.5 * dash:.4f}"))
    yield from ((49, f"{dash:.4f}"), (49, f"{-0.5 * dash:.4f}"), (0, "ENDTAB"))
    yield from ((0, "TABLE"), (2, "LAYER"), (70, str(len(used))))
    for name, dashed in sorted(used):
        colour = _COLOURS["INDEX" in name]
        yield from ((0, "LAYER"), (2, name or "0"), (70, "0"), (62, str(colour)), (6, _DASHED if dashed else _CONTINUOUS))
    yield from ((0, "ENDTAB"), (0, "ENDSEC"))


def _polyline(feature: Feature, closed: bool) -> str:
    places = feature.places
    # 8: a polyline in space, 1: closed; the first vertex of a closed one is not repeated.
    ring = closed or (len(places) > 2 and bool((places[0] == places[-1]).all()))
    name = feature.layer or "0"
    head = ((0, "POLYLINE"), (8, name), (66, "1"), (70, "9" if ring else "8"), *_place(np.zeros(3)))
    # All vertices of a line are formatted at once: they are most of a drawing, and take most of its time.
    vertex = _text_of([(0, "VERTEX"), (8, _literal(name)), (70, "32")]) + _PLACE
    drawn = places[:-1] if ring else places
    return _text_of(head) + (vertex * len(drawn)) % tuple(drawn.ravel().tolist()) + _text_of([(0, "SEQEND")])


def _literal(name: str) -> str:
    """A name in a text that is formatted."""
    return name.replace("%", "%%")


def _point(feature: Feature) -> Iterator[tuple[int, str]]:
    yield from ((0, "POINT"), (8, feature.layer or "0"))
    yield from _place(feature.places[0])


def _label(feature: Feature, size: float) -> Iterator[tuple[int, str]]:
    at = len(feature.places) // 2
    along = feature.places[min(at + 1, len(feature.places) - 1)] - feature.places[max(at - 1, 0)]
    angle = (np.degrees(np.arctan2(along[1], along[0])) + 90) % 180 - 90 if len(feature.places) > 1 else 0.0
    yield from ((0, "TEXT"), (8, _text_layer(feature)))
    yield from _place(feature.places[at])
    yield from ((40, f"{size:.3f}"), (1, feature.text), (50, f"{angle:.2f}"))


def _text_layer(feature: Feature) -> str:
    return f"{feature.layer}_TEXT"


def _place(place: np.ndarray) -> Iterator[tuple[int, str]]:
    yield from ((code, f"{value:.4f}") for code, value in zip((10, 20, 30), place, strict=True))
