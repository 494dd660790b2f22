"""Read configuration files: TOML, validated as a whole, all problems reported together."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from bscd.config.agreement import disagreements
from bscd.config.model import DeviceConfig, RigConfig, TargetFile
from bscd.config.problems import closest, sentences
from bscd.errors import InputError
from drivers.registry import DriverEntry, Registry, installed_drivers

DEVICE_KINDS = {
    "primary": "camera",
    "auxiliary": "camera",
    "rotation": "axis",
    "translation": "axis",
    "jacks": "axis",
    "pressure": "pressure",
}
WORLD_DRIVER = "world.twin"


def load_config(path: str | Path) -> RigConfig:
    """Read and validate a rig's configuration. Raises `InputError` naming file, key and what is allowed."""
    return parse_config(_read(Path(path)), str(path))


def parse_config(text: str, name: str = "configuration") -> RigConfig:
    """Validate a configuration's text; ``name`` stands in the messages."""
    raw = _parse(text, name)
    registry = installed_drivers()
    problems: list[str] = []
    devices = raw.get("devices")
    if isinstance(devices, dict):
        raw["devices"] = {key: _device(key, value, registry, problems) for key, value in devices.items()}
    if "twin" in raw:
        raw["twin"] = _validated(registry[WORLD_DRIVER], raw["twin"], "twin", problems)
    config = None
    try:
        config = RigConfig.model_validate(raw)
    except ValidationError as err:
        problems += sentences(err, RigConfig)
    if config is not None and not problems:
        problems += disagreements(config)
    if problems or config is None:
        raise _refusal(name, problems)
    return config


def load_target(path: str | Path) -> TargetFile:
    """Read the rig.toml beside a manifest ([target], [sphere], [lens] and the like), or a whole rig's file."""
    return parse_target(_read(Path(path)), str(path))


def parse_target(text: str, name: str = "rig.toml") -> TargetFile:
    """Validate what a file says of the imaged objects; sections of a whole rig's file are allowed and unused."""
    raw = _parse(text, name)
    if "devices" in raw:
        config = parse_config(text, name)
        told = {key: getattr(config, key) for key in ("lens", "light", "pattern") if key in raw}
        return TargetFile(target=config.target, sphere=config.sphere, membrane=config.membrane, **told)
    try:
        return TargetFile.model_validate(raw)
    except ValidationError as err:
        raise _refusal(name, sentences(err, TargetFile)) from err


def config_schema() -> dict[str, Any]:
    """The JSON schema of a configuration file, composed with the installed drivers' options."""
    schema = RigConfig.model_json_schema()
    registry = installed_drivers()
    definitions = schema["$defs"]

    def options_of(entry: DriverEntry) -> dict[str, Any]:
        inner = entry.options.model_json_schema(ref_template="#/$defs/{model}")
        definitions.update(inner.pop("$defs", {}))
        return inner

    devices = definitions["DevicesConfig"]["properties"]
    for kind in set(DEVICE_KINDS.values()):
        known = {name: entry for name, entry in registry.items() if entry.kind == kind}
        variants = [_with_driver(options_of(entry), name, definitions) for name, entry in known.items()]
        devices.update({key: {"oneOf": variants} for key, of_kind in DEVICE_KINDS.items() if of_kind == kind})
    schema["properties"]["twin"] = options_of(registry[WORLD_DRIVER])
    return schema


def _with_driver(schema: dict[str, Any], name: str, definitions: dict[str, Any]) -> dict[str, Any]:
    """The options' schema with the key ``driver`` beside the options, as in the file."""
    if "$ref" in schema:
        _with_driver(definitions[schema["$ref"].rpartition("/")[2]], name, definitions)
    for variant in schema.get("oneOf", []):
        _with_driver(variant, name, definitions)
    if "properties" in schema:
        schema["properties"]["driver"] = {"const": name}
        schema["required"] = sorted({"driver", *schema.get("required", [])})
    return schema


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as err:
        raise InputError(f"{path}: can not be read ({err.strerror}); name a TOML file") from err
    except UnicodeDecodeError as err:
        raise InputError(f"{path}: is not UTF-8 text; name a TOML file") from err


def _parse(text: str, name: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as err:
        raise InputError(f"{name}: not valid TOML: {err}") from err


def _device(key: str, value: Any, registry: Registry, problems: list[str]) -> Any:
    """A device's section with its options validated by the driver's own model."""
    kind = DEVICE_KINDS.get(key)
    if kind is None or not isinstance(value, dict):
        return value  # the model says what is wrong
    name = value.get("driver")
    entry = registry.get(name) if isinstance(name, str) else None
    if entry is None or entry.kind != kind:
        allowed = [other for other, one in registry.items() if one.kind == kind]
        if "driver" not in value:
            problems.append(f"[devices.{key}] driver: is missing; known: {', '.join(sorted(allowed))}")
            return DeviceConfig(driver="")
        guess = closest(str(name), allowed)
        hint = f"did you mean {guess}?" if guess else f"known: {', '.join(sorted(allowed))}"
        problems.append(f"[devices.{key}] driver = {name!r}: no such {kind} driver; {hint}")
        return DeviceConfig(driver=str(name))
    options = {option: given for option, given in value.items() if option != "driver"}
    return DeviceConfig(driver=str(name), options=_validated(entry, options, f"devices.{key}", problems))


def _validated(entry: DriverEntry, raw: Any, section: str, problems: list[str]) -> BaseModel | None:
    try:  # as JSON: strict there refuses "2" and true for a number, but takes a list for a tuple
        return entry.options.model_validate_json(json.dumps(raw, default=str), strict=True)
    except ValidationError as err:
        problems += sentences(err, entry.options, section)
        return None


def _refusal(name: str, problems: list[str]) -> InputError:
    return InputError("\n".join(f"{name}: {problem}" for problem in problems))
