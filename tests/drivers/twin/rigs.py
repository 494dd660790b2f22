"""Rigs for the twin's tests: the paper's, and one with coarse pixels and even light that renders quickly."""

from __future__ import annotations

from drivers.twin.options import TwinOptions

EVEN = {"ambient": 1.0, "gradient_per_mm": (0.0, 0.0, 0.0), "vignetting": 0.0}


def coarse_options(*, factor: int = 4, **parts) -> TwinOptions:
    """The paper's rig with ``factor`` times larger (and fewer) pixels, even light, no blur; ``parts`` override."""
    camera = {"pixel_size_mm": 0.0067 * factor, "width_px": 1280 // factor, "height_px": 1024 // factor}
    fields = {
        "primary": camera,
        "auxiliary": camera,
        "light": EVEN,
        "sensor": {"blur_px": 0.0},
        "sphere": {"speckle": {"spacing_mm": 0.13 * factor}},
        "membrane": {"speckle": {"spacing_mm": 0.13 * factor}},
    }
    return TwinOptions.model_validate(fields | parts)
