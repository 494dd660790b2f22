"""What a configuration says of the setup in words, for a report."""

from __future__ import annotations

from bscd.config import parse_target


def setup_facts(config_text: str) -> dict[str, str]:
    """Lens, aperture, light and pattern as far as a run's configuration tells them; `InputError` for a bad one."""
    told = parse_target(config_text, "the run's configuration")
    facts = {}
    if told.lens is not None:
        facts |= {"lens": told.lens.description, "aperture": told.lens.aperture}
    if told.light is not None:
        band = f"{told.light.wavelength_nm:g} ± {told.light.bandwidth_nm / 2.0:g} nm"
        facts["light"] = f"{told.light.description}, {band}" if told.light.description else band
    if told.pattern is not None:
        facts["pattern"] = told.pattern.technique
    return {name: text for name, text in facts.items() if text}
