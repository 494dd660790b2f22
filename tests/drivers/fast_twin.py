"""The twin's configuration with axes that waste no time."""

from __future__ import annotations

from pathlib import Path

TWIN = Path(__file__).parents[2] / "config/twin.toml"

#: So that moves in real time take no longer than they must.
FAST = {
    'quantity = "rotation"': "speed_deg_s = 90.0\nacceleration_deg_s2 = 360.0\nhoming_speed_deg_s = 90.0",
    'quantity = "translation"': "speed_mm_s = 50.0\nacceleration_mm_s2 = 150.0\nhoming_speed_mm_s = 50.0",
    'quantity = "jack"': "speed_mm_s = 20.0\nacceleration_mm_s2 = 80.0\nhoming_speed_mm_s = 20.0",
}


def fast_twin() -> str:
    text = TWIN.read_text(encoding="utf-8")
    for line, more in FAST.items():
        text = text.replace(line, f"{line}\n{more}")
    return text
