"""Validation errors as sentences that an operator understands: key, value, what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, RootModel, ValidationError
from pydantic.fields import FieldInfo

_UNITS = ("mm", "cm", "um", "m", "px", "deg", "rad", "kpa", "pa", "bar", "s", "ms", "nm", "db", "hz", "mm_s", "deg_s")

_NUMBERS = {
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "greater_than": "",
    "greater_than_equal": "",
    "less_than": "",
    "less_than_equal": "",
}
_SHAPES = {
    "bool_type": "must be true or false",
    "dict_type": "must be a section with keys of its own",
    "list_type": "must be a list in [ ]",
    "missing": "is missing",
    "model_type": "must be a section with keys of its own",
    "string_too_short": "must not be empty",
    "string_type": "must be text in quotes",
    "tuple_type": "must be a list in [ ]",
}


def sentences(error: ValidationError, model: type[BaseModel], section: str = "") -> list[str]:
    """One sentence a problem, the section's name before each."""
    return [_sentence(problem, model, section) for problem in error.errors(include_url=False)]


def _sentence(problem: Any, model: type[BaseModel], section: str) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    owners, path = _walk(model, [part for part in problem["loc"] if isinstance(part, str)])
    where = " ".join(filter(None, [f"[{section}]" if section else "", ".".join(path)]))
    if kind == "missing" and isinstance(problem["loc"][-1], int):
        return f"{where}: has too few values"
    if kind == "too_long":
        return f"{where}: has {context['actual_length']} values; must have {context['max_length']}"
    if kind == "extra_forbidden":
        known = [name for owner in owners for name in owner.model_fields]
        guess = closest(path[-1], known)
        return f"{where}: unknown key; " + (f"did you mean {guess}?" if guess else f"allowed: {', '.join(known)}")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        key = str(context["discriminator"]).strip("'")
        given = f" = {context['tag']!r}: must" if "tag" in context else ": is missing; must"
        return f"{where} {key}{given} be one of {', '.join(map(repr, _tags(owners, key)))}"
    value = problem.get("input")
    given = f" = {_toml(value)}" if isinstance(value, (int, float, str)) else ""
    return f"{where}{given}: {_rule(kind, problem['msg'], _field(owners, path))}"


def _toml(value: float | str) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _rule(kind: str, message: str, field: FieldInfo | None) -> str:
    if kind in _NUMBERS:
        rule = ", ".join(filter(None, [_NUMBERS[kind], _bounds(field)]))
        if rule:
            return f"must be {rule}"
    if kind in _SHAPES:
        return _SHAPES[kind]
    message = message.removeprefix("Value error, ")
    return (message[:1].lower() + message[1:]).replace("input should", "must")


def _bounds(field: FieldInfo | None) -> str:
    """The interval that a field allows, in words; empty for none."""
    rules = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
    found = [(name, getattr(rule, name, None)) for name in rules for rule in (field.metadata if field else ())]
    return " and ".join(f"{rules[name]} {bound:g}" for name, bound in found if bound is not None)


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


def _walk(model: type[BaseModel], path: Sequence[str]) -> tuple[list[type[BaseModel]], list[str]]:
    """The models that may own the last key of ``path``, and the path without unions' tags, which no file has."""
    owners = _models_in(model)
    shown: list[str] = []
    for place, part in enumerate(path):
        chosen = [owner for owner in owners if len(owners) > 1 and part in _tags([owner])]
        if chosen:
            owners = chosen
            continue
        shown.append(part)
        if place + 1 < len(path):
            fields = [owner.model_fields[part] for owner in owners if part in owner.model_fields]
            owners = [inner for field in fields for inner in _models_in(field.annotation)] or owners
    return owners, shown


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        is_root = issubclass(annotation, RootModel)
        return _models_in(annotation.model_fields["root"].annotation) if is_root else [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _tags(owners: Sequence[type[BaseModel]], key: str | None = None) -> list[str]:
    """Values of the models' literal fields (of the field ``key`` alone where it is given)."""
    fields = [field for owner in owners for name, field in owner.model_fields.items() if key in (None, name)]
    return [tag for field in fields if get_origin(field.annotation) is Literal for tag in get_args(field.annotation)]


def _field(owners: Sequence[type[BaseModel]], path: Sequence[str]) -> FieldInfo | None:
    return next((owner.model_fields[path[-1]] for owner in owners if path and path[-1] in owner.model_fields), None)
