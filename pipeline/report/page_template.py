"""The templates of the report, with what they need to print numbers."""

import re
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup, escape

from orthomill.pipeline.report import numbers


@cache
def page_template(name: str) -> Template:
    """A template of the folder beside this file."""
    # StrictUndefined: a misspelt name in the template fails in the tests instead of leaving a gap in the page.
    loader = FileSystemLoader(Path(__file__).parent / "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(
        number=numbers.number_text, duration=numbers.duration_text, memory=numbers.memory_text, ground_length=length_text
    )
    environment.filters.update(bytes=numbers.bytes_text, subscripts=subscripts)
    return environment.get_template(name)


def subscripts(sentence: str) -> Markup:
    """RMSE_H as a standard prints it."""
    parts = re.split(r"RMSE_(H|V|3D)\b", sentence)
    # Every second part is what the pattern caught.
    return Markup().join(Markup("RMSE<sub>{}</sub>").format(part) if n % 2 else escape(part) for n, part in enumerate(parts))


def length_text(metres: float) -> str:
    """A length on the ground: 50 m, 2 km, 5 mm."""
    if metres >= 1000:
        return f"{metres / 1000:g}{numbers.NARROW_SPACE}km"
    if metres < 0.1:
        return f"{metres * 1000:g}{numbers.NARROW_SPACE}mm"
    return f"{metres:g}{numbers.NARROW_SPACE}m"
