"""Calibration of the standard stereo pair and of the biprism's two virtual cameras; pure numerics.

Only `Calibration.load` and `Calibration.save` touch a file.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
