"""A matplotlib figure as SVG for a page with many: own ids, nothing outside the page, the page's type and ink."""

from __future__ import annotations

import io
import re

from matplotlib.figure import Figure

from bscd.analysis.figures import house_style
from bscd.analysis.figures.style import INK

_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}
_ANY_ID = re.compile(r' id="([^"]*)"')
_IDS = re.compile(r'(\bid="|url\(#|\bhref="#)')
_FONT = re.compile(r"font: ((?:[\w.]+ )*)([\d.]+px) [^;\"]*")


def inline_svg(figure: Figure, prefix: str, title: str) -> str:
    """The ``<svg>`` element of a figure.

    Every id begins with ``prefix``, so that figures do not take each other's clips and markers; the figures' ink
    becomes ``currentColor``; ``title`` is what a screen reader says.
    """
    buffer = io.StringIO()
    with house_style():
        figure.savefig(buffer, format="svg", metadata=_NO_METADATA)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)  # a page-wide rule; the page's own CSS has it
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text)
    text = text.replace("xlink:href", "href")
    used = set(re.findall(r"#([\w.-]+)", text))
    text = _ANY_ID.sub(lambda match: match[0] if match[1] in used else "", text)
    text = _IDS.sub(lambda match: f"{match[1]}{prefix}-", text)
    text = _FONT.sub(lambda match: f"font: {match[1]}{match[2]} var(--figure-type)", text)
    text = text.replace(INK, "currentColor")
    box = re.search(r'viewBox="[^"]*"', text)
    width = re.search(r'width="([\d.]+)pt"', text)
    head = f'<svg role="img" aria-label="{title}" {box[0] if box else ""} '
    head += f'style="max-width:{float(width[1]) * 96 / 72:.0f}px">' if width else ">"
    return head + text[text.index(">") + 1 :].strip()
