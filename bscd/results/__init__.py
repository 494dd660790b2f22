"""Results: measured shapes and displacements of a run, kept and read back; `bscd.results.export` hands them on."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
