"""What every page of a report is made with: templates, figures put into them, the file written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from bscd.analysis.figures import house_style
from bscd.analysis.report.picture import Picture
from bscd.analysis.report.svg import inline_svg

_PNG_DPI = 150


def place_pictures(pictures: Iterable[Picture], folder: Path) -> dict[str, dict[str, str]]:
    """Save each figure as PNG in a folder; by name, its words and its SVG for the page."""
    return {picture.name: _place(picture, folder) for picture in pictures}


def write_page(template: str, folder: Path, **content: Any) -> Path:
    """Render a template into ``report.html`` in a folder; the page's path."""
    environment = Environment(
        loader=PackageLoader("bscd.analysis.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = folder / "report.html"
    unfinished = page.with_name("report.html.part")
    unfinished.write_text(environment.get_template(template).render(**content), encoding="utf-8")
    os.replace(unfinished, page)
    return page


def _place(picture: Picture, folder: Path) -> dict[str, str]:
    with house_style():
        picture.figure.savefig(folder / f"{picture.name}.png", dpi=_PNG_DPI, facecolor="white")
    svg = inline_svg(picture.figure, picture.name, picture.title)
    # our own drawing, its texts escaped by matplotlib
    return {"title": picture.title, "explanation": picture.explanation, "svg": Markup(svg)}  # noqa: S704
