"""Standa stages on XIMC controllers (8SMC4, 8SMC5), by their serial protocol."""

from drivers.stages.ximc.options import HomingRecipe, XimcOptions

__all__ = ["HomingRecipe", "XimcOptions"]
