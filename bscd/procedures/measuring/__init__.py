"""Measuring: from a run and a calibration to shape, displacement and strain (DESIGN section 3, steps 4 to 6)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
