"""The page on measuring names every option and every status that there is."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from bscd.procedures.measuring import MeasureSettings, PointStatus

PAGE = (Path(__file__).resolve().parents[2] / "docs/measuring.md").read_text()


def section(title: str) -> str:
    return PAGE.partition(f"\n## {title}")[2].partition("\n## ")[0]


def test_every_status_with_its_code():
    rows = re.findall(r"(?m)^\| (\d+) \| `(\w+)` \|", section("What became of a point"))
    assert [(int(code), name) for code, name in rows] == [(code.value, code.name.lower()) for code in PointStatus]


@pytest.mark.parametrize("field", fields(MeasureSettings), ids=lambda field: field.name)
def test_every_option_with_its_default(field):
    row = re.search(rf"(?m)^\| `{field.name}` \| ([^|]+) \|", section("Options"))
    assert row
    if isinstance(field.default, int | float) and not isinstance(field.default, bool):
        assert row[1] == f"{field.default:g}"
    if isinstance(field.default, bool):
        assert row[1] == ("yes" if field.default else "no")


def test_its_links_lead_somewhere():
    for name in re.findall(r"`(docs/[\w./-]+)`", PAGE):
        assert (Path(__file__).resolve().parents[2] / name).is_file(), name
