"""bscd: a measurement daemon for biprism single-camera stereo-DIC rigs.

For notebooks and scripts: `calibrate`, `measure` and `open_results`, and `Client` for a running daemon; what they need
is loaded when first named.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from bscd.version import __version__

if TYPE_CHECKING:
    from bscd.client import AsyncClient, Client
    from bscd.offline import MeasuredRun, calibrate, measure, open_results

__all__ = ["AsyncClient", "Client", "MeasuredRun", "__version__", "calibrate", "measure", "open_results"]

_CLIENTS = ("AsyncClient", "Client")


def __getattr__(name: str) -> Any:
    """Load what is asked for by name (PEP 562), so that ``import bscd`` stays cheap."""
    if name not in __all__:
        raise AttributeError(f"module 'bscd' has no attribute {name!r}")
    return getattr(importlib.import_module("bscd.client" if name in _CLIENTS else "bscd.offline"), name)


def __dir__() -> list[str]:
    """The public names, for completion."""
    return [*globals(), *(name for name in __all__ if name not in globals())]
