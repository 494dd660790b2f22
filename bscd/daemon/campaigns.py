"""Recipes and campaigns from files: TOML, YAML or JSON."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import TypeAdapter, ValidationError

from bscd.daemon.recipes import RECIPES, AnyRecipe
from bscd.errors import InputError

_RECIPE: TypeAdapter[Any] = TypeAdapter(AnyRecipe)

#: A campaign of 500 steps has far less.
_MOST_BYTES = 1_000_000


def load_recipe(path: str | os.PathLike[str], changes: Mapping[str, Any] | None = None) -> Any:
    """The recipe of a file, with ``changes`` to it. Raises `InputError` with every problem and its place."""
    file = Path(path)
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise InputError(f"{file}: is {file.stat().st_size} bytes long; a recipe has a few thousand")
        text = file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: is no text; name a TOML or YAML file") from error
    except OSError as error:
        raise InputError(f"{file}: can not be read ({error.strerror}); name a recipe's file") from error
    return recipe_of(_merged(_parsed(file, text), changes or {}), str(file))


def recipe_of(told: Any, where: str) -> Any:
    """A recipe from plain values. Raises `InputError`."""
    if not isinstance(told, dict):
        raise InputError(f'{where}: holds no recipe; it begins with recipe = "campaign" or another recipe\'s name')
    if told.get("recipe") not in RECIPES:
        raise InputError(f"{where}: recipe = {told.get('recipe')!r} is not known; known are {', '.join(RECIPES)}")
    try:
        return _RECIPE.validate_python(told)
    except ValidationError as error:
        problems = [f"{_place(one['loc'], told)}: {_message(one)}" for one in error.errors()]
        raise InputError(f"{where}: {'; '.join(problems)}") from error


def _parsed(file: Path, text: str) -> Any:
    try:
        if file.suffix == ".json":
            return json.loads(text)
        return tomllib.loads(text) if file.suffix == ".toml" else yaml.safe_load(text)
    except (ValueError, yaml.YAMLError) as error:
        told = " ".join(str(error).split())
        raise InputError(f"{file}: is no {file.suffix.lstrip('.').upper() or 'YAML'}: {told}") from error


def _merged(told: Any, changes: Mapping[str, Any]) -> Any:
    if not isinstance(told, dict):
        return told
    merged = dict(told)
    for name, value in changes.items():
        before = merged.get(name)
        merged[name] = _merged(before, value) if isinstance(before, dict) and isinstance(value, dict) else value
    return merged


def _place(location: tuple[int | str, ...], told: Mapping[str, Any]) -> str:
    """Where it is, steps by their names."""
    parts = [str(part) for part in location if part not in RECIPES]
    if len(location) > 2 and "steps" in location:
        number = location[location.index("steps") + 1]
        steps = told.get("steps")
        if isinstance(number, int) and isinstance(steps, list) and isinstance(steps[number], dict):
            name = steps[number].get("name", f"number {number + 1}")
            after = parts[parts.index("steps") + 2 :]
            return f"step {name}, {'.'.join(part for part in after if part != 'do') or 'itself'}"
    return ".".join(parts) or "the recipe"


def _message(problem: Any) -> str:
    return str(problem["msg"]).removeprefix("Value error, ")
