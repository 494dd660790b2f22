"""The pages on the cameras name every option that there is, with its default."""

import re
import tomllib
from pathlib import Path

import pytest

from bscd.acquisition.replay import ReplayOptions
from drivers.cameras.aravis import AravisOptions
from drivers.cameras.v4l2 import V4l2Options

ROOT = Path(__file__).resolve().parents[2]
PAGES = {"aravis": AravisOptions, "v4l2": V4l2Options, "replay": ReplayOptions}


def shown(field) -> str:
    if field.is_required():
        return "required"
    if field.default is None or field.default == "":
        return "-"
    if isinstance(field.default, bool):
        return str(field.default).lower()
    return str(list(field.default)) if isinstance(field.default, tuple) else str(field.default)


@pytest.mark.parametrize("page", PAGES)
def test_every_option_with_its_default_and_no_other(page):
    options = (ROOT / f"docs/drivers/{page}.md").read_text().partition("\n## Options")[2].partition("\n## ")[0]
    rows = dict(re.findall(r"(?m)^\| `(\w+)` \| ([^|]+) \|", options))
    assert rows == {name: shown(field) for name, field in PAGES[page].model_fields.items()}


@pytest.mark.parametrize("page", PAGES)
def test_the_example_is_accepted(page):
    example = re.search(r"```toml\n(.*?)```", (ROOT / f"docs/drivers/{page}.md").read_text(), re.DOTALL)
    assert example
    device = tomllib.loads(example[1])["devices"]["primary"]
    assert device["driver"] == f"camera.{page}"
    PAGES[page].model_validate(device["options"])
