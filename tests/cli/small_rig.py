"""Configurations for the commands: the twin with few pixels, and other drivers in place of some of its devices."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def small_twin(devices: Mapping[str, Mapping[str, Any]] | None = None) -> str:
    """The twin with a sensor of 320 x 256, and these sections in place of its devices of the same names."""
    text = (ROOT / "config/twin.toml").read_text()
    for old, new in (("width_px = 1280", "width_px = 320"), ("height_px = 1024", "height_px = 256")):
        text = text.replace(old, new)
    text = text.replace("pixel_size_mm = 0.0067", "pixel_size_mm = 0.0268")
    for name, section in (devices or {}).items():
        text = re.sub(rf"\[devices\.{name}\]\n[^\[]*", "", text)
        text += "".join(f"{line}\n" for line in _lines(f"devices.{name}", section))
    return text


def _lines(name: str, section: Mapping[str, Any]) -> Iterator[str]:
    yield f"[{name}]"
    tables = {key: value for key, value in section.items() if isinstance(value, Mapping)}
    for key, value in section.items():
        if key not in tables:
            yield f"{key} = {json.dumps(value)}"
    for key, value in tables.items():
        yield from _lines(f"{name}.{key}", value)
