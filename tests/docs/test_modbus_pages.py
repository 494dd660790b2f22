"""The pages of the jacks and the LabJack: their examples are valid in a rig's configuration, their tables tell all."""

import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from bscd.config import load_config
from drivers.jacks.manual import ManualJacksOptions
from drivers.jacks.modbus import ModbusJacksOptions, RegisterMap
from drivers.pressure.labjack_t7 import LabJackT7Options

ROOT = Path(__file__).resolve().parents[2]
PAGES = {
    "modbus-jacks": ("jacks", "axis.modbus", ModbusJacksOptions),
    "manual-jacks": ("jacks", "axis.manual", ManualJacksOptions),
    "labjack-t7": ("pressure", "pressure.labjack_t7", LabJackT7Options),
}


def read(page: str) -> str:
    return (ROOT / f"docs/drivers/{page}.md").read_text()


def names(model: type[BaseModel]) -> set[str]:
    """Names of the options, and those within them."""
    found = set(model.model_fields)
    for field in model.model_fields.values():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            found |= names(field.annotation)
    return found


def told(section: str) -> set[str]:
    """The names in the first column of a section's table."""
    cells = "\n".join(re.findall(r"^\| (`[^|]*)\|", section, re.MULTILINE))
    return {part for name in re.findall(r"`([a-z0-9_.]+)`", cells) for part in name.split(".") if part}


@pytest.mark.parametrize("page", PAGES)
def test_the_example_is_accepted_in_a_rigs_configuration(page, tmp_path):
    device, driver, options = PAGES[page]
    example = re.search(r"```toml\n(.*?)```", read(page), re.DOTALL)
    assert example
    before, _, after = (ROOT / "config/twin.toml").read_text().partition(f"[devices.{device}]")
    rest = re.search(rf"^\[(?!devices\.{device})", after, re.MULTILINE)
    config = tmp_path / "rig.toml"
    config.write_text(before + example[1] + "\n" + (after[rest.start() :] if rest else ""))
    loaded = getattr(load_config(config).devices, device)
    assert loaded.driver == driver
    assert isinstance(loaded.options, options)


@pytest.mark.parametrize("page", PAGES)
def test_the_table_tells_every_option_and_no_other(page):
    section = read(page).partition("\n## Options")[2].partition("\n## ")[0]
    assert told(section) == names(PAGES[page][2])


def test_the_register_map_s_table_tells_every_key():
    section = read("modbus-jacks").partition("\n## The register map")[2].partition("\n## ")[0]
    table = "\n".join(line for line in section.splitlines() if line.startswith("|"))
    assert {name for name in names(RegisterMap) if f"{name}" not in table} == set()


@pytest.mark.parametrize("address", ["0x007F", "0x00CC", "0x00C6", "0x0180"])
def test_what_nobody_checked_is_said(address):
    unchecked = read("modbus-jacks").partition("**Checked by nobody")[2].partition("\n\n")[0]
    assert address in unchecked
