"""One validated model of the rig, read from TOML; unknown keys are errors."""

from bscd.config.load import config_schema, load_config, load_target, parse_config, parse_target
from bscd.config.model import DeviceConfig, RigConfig, TargetConfig, TargetFile

__all__ = [
    "DeviceConfig",
    "RigConfig",
    "TargetConfig",
    "TargetFile",
    "config_schema",
    "load_config",
    "load_target",
    "parse_config",
    "parse_target",
]
