"""Formulae of the documentation become MathML when the site is built: every browser shows it, and no script or font is fetched."""

import html
import re

from latex2mathml.converter import convert

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_page_content(content: str, **_) -> str:
    """A page's HTML with its formulae, which arithmatex has marked, as MathML."""
    return _FORMULA.sub(lambda found: convert(html.unescape(found[3]), display="block" if found[2] == "[" else "inline"), content)
