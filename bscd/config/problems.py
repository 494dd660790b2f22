"""Validation errors as sentences that an operator understands: key, value, what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import BaseModel, RootModel, ValidationError

_UNITS = ("mm", "cm", "um", "m", "px", "deg", "rad", "kpa", "pa", "bar", "s", "ms", "nm", "db", "hz", "mm_s", "deg_s")


def sentences(error: ValidationError, model: type[BaseModel], section: str = "") -> list[str]:
    """One sentence a problem, the section's name before each."""
    return [_sentence(problem, model, section) for problem in error.errors(include_url=False)]


def _sentence(problem: Any, model: type[BaseModel], section: str) -> str:
    path = [str(part) for part in problem["loc"]]
    where = " ".join(filter(None, [f"[{section}]" if section else "", ".".join(_keys(path, model))]))
    if problem["type"] == "extra_forbidden":
        guess = closest(path[-1], known_keys(model, path[:-1]))
        return f"{where}: unknown key" + (f"; did you mean {guess}?" if guess else "; see `bscd config schema`")
    if problem["type"] == "missing":
        return f"{where}: is missing"
    if problem["type"] == "union_tag_invalid":
        context = problem["ctx"]
        key = str(context["discriminator"]).strip("'")
        return f"{where} {key} = {context['tag']!r}: must be one of {context['expected_tags']}"
    message = str(problem["msg"]).removeprefix("Value error, ")
    message = message[:1].lower() + message[1:]
    value = problem.get("input")
    given = f" = {value!r}" if isinstance(value, (int, float, str, bool)) else ""
    return f"{where}{given}: {message.replace('input should', 'must')}"


def closest(key: str, known: Iterable[str]) -> str | None:
    """The known key that was probably meant: the same with another unit, or spelled nearly so."""
    known = list(known)
    stem = _stem(key)
    same = [name for name in known if _stem(name) == stem]
    near = same or difflib.get_close_matches(key, known, n=1, cutoff=0.6)
    return near[0] if near else None


def _stem(key: str) -> str:
    for unit in sorted(_UNITS, key=len, reverse=True):
        if key.lower().endswith("_" + unit):
            return key[: -len(unit) - 1].lower()
    return key.lower()


def known_keys(model: type[BaseModel], path: Sequence[str]) -> list[str]:
    """Keys that the (nested) model at ``path`` allows; all of a union's."""
    models = [model]
    for part in path:
        models = [inner for one in models for inner in _inner(one, part)] or models
    return [name for one in models for name in _expand(one)]


def _expand(model: type[BaseModel]) -> list[str]:
    if issubclass(model, RootModel):
        return [name for one in _models_in(model.model_fields["root"].annotation) for name in one.model_fields]
    return list(model.model_fields)


def _inner(model: type[BaseModel], key: str) -> list[type[BaseModel]]:
    field = model.model_fields.get(key)
    return _models_in(field.annotation) if field else []


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in getattr(annotation, "__args__", ()) for model in _models_in(part)]


def _keys(path: list[str], model: type[BaseModel]) -> list[str]:
    """The path without the tags of unions, which the file does not have."""
    if issubclass(model, RootModel) and path and path[0] not in _expand(model):
        return path[1:]
    return path
