"""The pages on the cameras name every option that there is, with its default."""

import re
import tomllib
from pathlib import Path

import pytest

from bscd.acquisition.replay import ReplayOptions
from bscd.config import load_config
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
def test_the_example_is_accepted_in_a_rigs_configuration(page, tmp_path):
    example = re.search(r"```toml\n(.*?)```", (ROOT / f"docs/drivers/{page}.md").read_text(), re.DOTALL)
    assert example
    text = (ROOT / "config/twin.toml").read_text()
    before, _, after = text.partition("[devices.primary]")
    config = tmp_path / "rig.toml"
    config.write_text(before + example[1] + "\n[" + after.partition("\n[")[2])
    device = load_config(config).devices.primary
    assert device.driver == f"camera.{page}"
    assert isinstance(device.options, PAGES[page])
    assert device.options.model_fields_set == set(tomllib.loads(example[1])["devices"]["primary"]) - {"driver"}
