"""What the rig does: home, align, scan, calibrate, validate; every procedure ends with its reason and at rest."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
