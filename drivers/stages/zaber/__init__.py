"""Zaber stages, by their ASCII protocol."""

from drivers.stages.zaber.options import ZaberOptions

__all__ = ["ZaberOptions"]
