"""The page on recording says what the code does: reasons of losses, defaults, options."""

import re
from pathlib import Path

from bscd.acquisition.stream.session import RING_FULL
from bscd.cli.app import run
from bscd.procedures.recording import InflationRecipe, Storing
from bscd.procedures.recording.frames import BY_CAMERA, SILENT_S

PAGE = (Path(__file__).resolve().parents[2] / "docs/recording.md").read_text()


def test_the_reasons_of_losses_are_those_of_the_code():
    assert f"`{BY_CAMERA}`" in PAGE
    assert f"`{RING_FULL}`" in PAGE


def test_the_defaults_are_those_of_the_code():
    recipe, storing = InflationRecipe(), Storing()
    assert f"fell by {recipe.burst_fall:.0%}".replace("%", " %") in PAGE
    assert f"sent nothing for {SILENT_S:g} s or was away for {recipe.away_s:g} s" in PAGE
    assert f"ring of {storing.ring_frames} buffers" in PAGE
    assert f"{storing.reserve_bytes / 1e6:.0f} MB\nare left free" in PAGE
    assert (InflationRecipe(top_kpa=2.0).highest_kpa, InflationRecipe(top_kpa=10.0).highest_kpa) == (2.5, 11.0)


def test_every_option_on_the_page_exists(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    run(["record", "--help"])
    run(["recover", "--help"])
    told = capsys.readouterr().out
    for option in set(re.findall(r"--[a-z][a-z-]+", PAGE)) - {"--help"}:
        assert option in told, option
