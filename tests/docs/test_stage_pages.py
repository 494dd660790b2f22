"""The pages of the stages: their examples are valid, and their tables tell every option."""

import re
import tomllib
from pathlib import Path

import pytest

from drivers.registry import DriverContext, installed_drivers

PAGES = Path(__file__).resolve().parents[2] / "docs/drivers"


def read(page: str) -> str:
    return (PAGES / f"{page}.md").read_text()


@pytest.mark.parametrize("page", ["ximc", "zaber"])
def test_the_example_is_valid(page):
    (example,) = re.findall(r"```toml\n(.*?)```", read(page), re.DOTALL)
    devices = tomllib.loads(example)["devices"]
    assert devices.keys() == {"rotation", "translation"}
    for name, unit in (("rotation", "deg"), ("translation", "mm")):
        options = devices[name]
        assert options.pop("driver") == f"axis.{page}"
        assert options["unit"] == unit
        installed_drivers()[f"axis.{page}"].build(options, DriverContext(name))


@pytest.mark.parametrize("page", ["ximc", "zaber"])
def test_the_table_tells_every_option(page):
    cells = "\n".join(re.findall(r"^\| (`[^|]*)\|", read(page), re.MULTILINE))
    told = set(re.findall(r"`([a-z_]+)`", cells))
    assert told == set(installed_drivers()[f"axis.{page}"].options.model_fields)


def test_the_recipe_tells_every_part():
    homing = read("ximc").partition("## Homing")[2].partition("\n## ")[0]
    schema = installed_drivers()["axis.ximc"].options.model_json_schema()["$defs"]["HomingRecipe"]
    assert all(f"`{part}`" in homing for part in schema["properties"])
