"""Digital image correlation in the plane: where points of one image are in another, and how sure that is.

Pure numerics on arrays; `correlate` is the front door.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
